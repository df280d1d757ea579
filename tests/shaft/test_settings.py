"""Settings of the estimators: an error names the wrong setting and the values allowed."""

from __future__ import annotations

import numpy as np
import pytest

from textile_twin_core.errors import SceneError
from textile_twin_core.shaft import ESTIMATORS, create_estimator

POSITIVE = "give a positive finite number"


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"encoder_bits": 0}, f"encoder_bits is 0: {POSITIVE}"),
        ({"resolution_rad": "0.01"}, f"resolution_rad is '0.01': {POSITIVE}"),
        ({"resolution_rad": -0.01}, f"resolution_rad is -0.01: {POSITIVE}"),
        ({"stamp_jitter_s": -1e-5}, "stamp_jitter_s is -1e-05: give a finite number, 0 or more, or None"),
        ({"teeth": 1.5}, "teeth is 1.5: give a whole number from 0 to 10000"),
        ({"teeth": -1}, "teeth is -1: give a whole number from 0 to 10000"),
        ({"teeth": 60, "tooth_zero_rad": np.nan}, "tooth_zero_rad is nan: give a finite number"),
        (
            {"teeth": 3, "pitch_errors_rad": (0.0,)},
            "pitch_errors_rad has 1 values: give one finite number for each of 3 teeth",
        ),
        ({"cycle_turns": 0}, "cycle_turns is 0: give a whole number from 1 to 64"),
        ({"period_rad": 0}, f"period_rad is 0: {POSITIVE}"),
        ({"period_rad": np.inf}, f"period_rad is inf: {POSITIVE}"),
        ({"wrapping": "x"}, "wrapping is 'x': choose one of auto, wrapped, unwrapped"),
    ],
)
def test_settings_of_wrong_kind_or_value_are_named(name: str, wrong: dict[str, object], message: str) -> None:
    with pytest.raises(SceneError) as caught:
        create_estimator(name, **wrong)
    assert str(caught.value) == message


def test_the_lag_must_be_positive() -> None:
    with pytest.raises(SceneError, match=f"shaft_lag_s is 'x': {POSITIVE}"):
        create_estimator("lag", shaft_lag_s="x")


@pytest.mark.parametrize("name", ESTIMATORS)
def test_settings_may_be_numpys_numbers(name: str) -> None:
    create_estimator(name, cycle_turns=np.int64(2), encoder_bits=np.float64(14))


def test_angles_configured_as_unwrapped_keep_their_turns() -> None:
    """A shaft of 400 rad/s at 100 Hz moves by more than half a turn: wrapped, it would seem to run backwards."""
    time = np.arange(400) / 100.0
    states = create_estimator("causal", wrapping="unwrapped").step(time, 400.0 * time)
    assert np.allclose(states.omega_rad_s[50:], 400.0)
