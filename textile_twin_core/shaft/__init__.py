"""Estimation of the main shaft's angle, speed and acceleration, with their covariance, from angle samples."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from textile_twin_core.errors import SceneError
from textile_twin_core.shaft.estimator import ShaftEstimator
from textile_twin_core.shaft.fixed_interval import SmoothEstimator
from textile_twin_core.shaft.fixed_lag import LagEstimator
from textile_twin_core.shaft.settings import ShaftSettings
from textile_twin_core.shaft.states import OneState, SampleReport, ShaftStates

_VIEWS: dict[str, Any] = {"causal": ShaftEstimator, "lag": LagEstimator, "smooth": SmoothEstimator}
ESTIMATORS = tuple(_VIEWS)

__all__ = ["ESTIMATORS", "OneState", "SampleReport", "ShaftEstimator", "ShaftStates", "create_estimator"]


def create_estimator(name: str, **settings: Any) -> ShaftEstimator:
    """Create the shaft estimator of a view.

    Args:
        name: "causal" (no lag), "lag" (fixed lag) or "smooth" (fixed interval).
        settings: fields of `ShaftSettings`; for "lag" also `shaft_lag_s` [s].

    Returns:
        An estimator that has seen no sample.

    Raises:
        SceneError: an unknown name, an unknown setting, or a setting of the wrong kind or value.

    Examples:
        >>> import numpy as np
        >>> time = np.arange(500) * 0.002
        >>> states = create_estimator("causal").step(time, 30.0 * time)
        >>> bool(abs(states.omega_rad_s[-1] - 30.0) < 1e-3)
        True
    """
    if name not in ESTIMATORS:
        raise SceneError(f"unknown shaft estimator '{name}': choose one of {', '.join(ESTIMATORS)}")
    known = [field.name for field in fields(ShaftSettings)] + ["shaft_lag_s"] * (name == "lag")
    for setting in settings:
        if setting not in known:
            raise SceneError(f"shaft estimator '{name}' has no setting '{setting}'; available: {', '.join(known)}")
    try:
        estimator: ShaftEstimator = _VIEWS[name](**settings)
    except TypeError as error:
        raise SceneError(f"shaft estimator '{name}': {error}") from error
    return estimator
