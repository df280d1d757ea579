"""Common interface of linkage and contact machines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol, TypeVar

from textile_twin_core.machine.sensors import Scene, Sensors


@dataclass(frozen=True)
class Event:
    """A named event of a machine.

    Attributes:
        name: name of the event, such as `needle_enters_backing`.
        angle_rad: shaft angle in [0, 2 pi) [rad].
    """

    name: str
    angle_rad: float


class AnyMachine(Protocol):
    """A machine with one shaft: a linkage (Machine), or bodies between springs and stops (ContactMachine).

    Implementations are frozen dataclasses.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def name(self) -> str:
        """Name of the machine in messages, files and topics."""
        ...

    @property
    def description(self) -> str:
        """One line for lists."""
        ...

    @property
    def parameters(self) -> Mapping[str, float]:
        """Numeric parameters of a machine of the catalogue, by name; empty for a user's own machine."""
        ...

    @property
    def choices(self) -> Mapping[str, str]:
        """Textual parameters of the same, such as a design's name."""
        ...

    @property
    def sensors(self) -> Sensors:
        """Sensors on the shaft."""
        ...

    @property
    def scene(self) -> Scene:
        """Default outputs, method and tolerance."""
        ...

    @property
    def nominal_speed_rad_s(self) -> float:
        """Shaft speed [rad/s] at which errors and events are judged."""
        ...

    @property
    def missing_for_torque(self) -> tuple[str, ...]:
        """Parameters that are missing for a torque."""
        ...

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all outputs."""
        ...

    @property
    def shown_outputs(self) -> tuple[str, ...]:
        """Outputs shown by default: the torque and the tools' motion."""
        ...

    @property
    def has_history(self) -> bool:
        """True if the state depends on earlier samples, not on the shaft's state alone."""
        ...

    @property
    def has_complete_torque(self) -> bool:
        """True if the balancing torque at a sample is complete, without impulses between samples."""
        ...

    @property
    def tools(self) -> Mapping[str, str]:
        """Point whose displacement each measure gives, by the measure's name."""
        ...

    @property
    def joint_outputs(self) -> Mapping[str, tuple[str, str]]:
        """Outputs for position and velocity of each moving joint of the robot description, by joint name."""
        ...

    def events(self) -> tuple[Event, ...]:
        """Return the events of one turn by shaft angle; empty for a machine with history, whose motion yields them."""
        ...

    def urdf(self) -> str:
        """Build the robot description (URDF)."""
        ...


SomeMachine = TypeVar("SomeMachine", bound=AnyMachine)


def with_encoder(machine: SomeMachine, settings: Mapping[str, float]) -> SomeMachine:
    """Return the machine with other encoder settings.

    Args:
        machine: the machine.
        settings: values by name (see `ENCODER_OPTIONS`).

    Raises:
        MachineError: for impossible settings.

    Examples:
        >>> import textile_twin_core as ttc
        >>> ttc.machines.with_encoder(ttc.machines.tufting(), {"teeth": 60}).sensors.encoder.teeth
        60
    """
    if not settings:
        return machine
    encoder = replace(machine.sensors.encoder, **settings)  # type: ignore[arg-type]
    return replace(machine, sensors=replace(machine.sensors, encoder=encoder))
