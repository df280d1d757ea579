"""Settings of the estimators: what is of the wrong kind or value is named, with what it must be."""

from __future__ import annotations

import numpy as np
import pytest

from textile_twin_core.errors import SceneError
from textile_twin_core.shaft import ESTIMATORS, create_estimator

POSITIVE = "give a positive finite number"
WHOLE = "give a whole number, 0 or more"


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"harmonics": -1}, f"harmonics is -1: {WHOLE}"),
        ({"harmonics": 2.5}, f"harmonics is 2.5: {WHOLE}"),
        ({"max_harmonics": "8"}, f"max_harmonics is '8': {WHOLE}"),
        ({"max_harmonics": 1}, "max_harmonics is 1, less than harmonics, 2: give at least as many"),
        ({"encoder_bits": 0}, f"encoder_bits is 0: {POSITIVE}"),
        ({"encoder_bits": "14"}, f"encoder_bits is '14': {POSITIVE}"),
        ({"resolution_rad": -0.01}, f"resolution_rad is -0.01: {POSITIVE}"),
        ({"stamp_jitter_s": -1e-5}, "stamp_jitter_s is -1e-05: give a finite number, 0 or more, or None"),
        ({"response_s": np.nan}, f"response_s is nan: {POSITIVE}"),
        ({"period_rad": 0}, f"period_rad is 0: {POSITIVE}"),
        ({"period_rad": np.inf}, f"period_rad is inf: {POSITIVE}"),
        ({"gap_s": 0.0}, f"gap_s is 0.0: {POSITIVE}"),
        ({"wrapping": "x"}, "wrapping is 'x': choose one of auto, wrapped, unwrapped"),
    ],
)
def test_settings_of_wrong_kind_or_value_are_named(name: str, wrong: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        create_estimator(name, **wrong)
    assert str(caught.value) == message


def test_times_of_the_recursive_estimators_must_be_positive() -> None:
    with pytest.raises(SceneError, match=f"memory_s is 0: {POSITIVE}"):
        create_estimator("causal", memory_s=0)
    with pytest.raises(SceneError, match=f"shaft_lag_s is 'x': {POSITIVE}"):
        create_estimator("lag", shaft_lag_s="x")


@pytest.mark.parametrize("name", ESTIMATORS)
def test_settings_may_be_numpys_numbers_and_a_gap_infinite(name: str) -> None:
    create_estimator(name, harmonics=np.int64(1), encoder_bits=np.float64(14), gap_s=np.inf)
