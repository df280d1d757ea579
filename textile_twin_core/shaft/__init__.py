"""From angle samples of the main shaft to its angle, speed and acceleration, with their covariance."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from textile_twin_core.errors import SceneError
from textile_twin_core.shaft.estimator import ShaftEstimator
from textile_twin_core.shaft.fixed_interval import SmoothEstimator
from textile_twin_core.shaft.fixed_lag import LagEstimator
from textile_twin_core.shaft.report import SampleReport
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.states import OneState, ShaftStates

_VIEWS: dict[str, Any] = {"causal": ShaftEstimator, "lag": LagEstimator, "smooth": SmoothEstimator}
ESTIMATORS = tuple(_VIEWS)

__all__ = ["ESTIMATORS", "OneState", "SampleReport", "ShaftEstimator", "ShaftStates", "create_estimator"]


def create_estimator(name: str, **settings: Any) -> ShaftEstimator:
    """The estimator of that name: causal, lag or smooth.

    Raises:
        SceneError: no such estimator, or a setting that it does not have or of the wrong kind or value.
    """
    if name not in ESTIMATORS:
        raise SceneError(f"unknown shaft estimator '{name}': choose one of {', '.join(ESTIMATORS)}")
    known = [field.name for field in fields(ShaftSettings)] + ["shaft_lag_s"] * (name == "lag")
    for setting in settings:
        if setting not in known:
            raise SceneError(f"shaft estimator '{name}' has no setting '{setting}'; there are: {', '.join(known)}")
    try:
        estimator: ShaftEstimator = _VIEWS[name](**settings)
    except TypeError as error:
        raise SceneError(f"shaft estimator '{name}': {error}") from error
    return estimator
