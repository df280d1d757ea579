"""Parameters of the sensors on the shaft, which every published linkage accepts beside its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, TypedDict

from textile_twin_core.machine.sensors import Encoder, Sensors, TorqueSensor


class SensorNumbers(TypedDict, total=False):
    """Sensor parameters by name."""

    encoder_zero_rad: float
    torque_sensor_gain: float
    torque_sensor_offset_Nm: float
    torque_sensor_delay_s: float


SENSOR_DEFAULTS: Final[SensorNumbers] = {
    "encoder_zero_rad": 0.0,
    "torque_sensor_gain": 1.0,
    "torque_sensor_offset_Nm": 0.0,
    "torque_sensor_delay_s": 0.0,
}


def sensors_of(given: SensorNumbers) -> Sensors:
    """Build the sensors from these parameters."""
    values = SENSOR_DEFAULTS | given
    return Sensors(
        Encoder(zero_rad=values["encoder_zero_rad"]),
        TorqueSensor(values["torque_sensor_gain"], values["torque_sensor_offset_Nm"], values["torque_sensor_delay_s"]),
    )


def numbers_of(given: Mapping[str, Any]) -> dict[str, float]:
    """Collect every number among a factory's arguments by name: its own, then those of the `sensors`.

    Raises:
        TypeError: for a name that neither the factory nor the sensors have.
    """
    for name in given["sensors"]:
        if name not in SENSOR_DEFAULTS:
            raise TypeError(f"a published machine has no parameter '{name}'")
    own = {name: value for name, value in given.items() if name != "sensors"}
    values = own | SENSOR_DEFAULTS | given["sensors"]
    return {name: float(value) for name, value in values.items() if value is not None}
