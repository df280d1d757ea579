"""What the rest of the house needs of a machine, whatever moves it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar, Protocol, TypeVar

from textile_twin_core.machine.event import Event
from textile_twin_core.machine.sensors import Scene, Sensors


class AnyMachine(Protocol):
    """A machine with one shaft: a linkage (Machine), or bodies between springs and stops (ContactMachine).

    Implementations are frozen dataclasses.
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def name(self) -> str:
        """Its name in messages, files and topics."""
        ...

    @property
    def description(self) -> str:
        """One line for lists."""
        ...

    @property
    def parameters(self) -> Mapping[str, float]:
        """Numbers of a machine of the catalogue, by the name of their parameter; empty for one of a user's own."""
        ...

    @property
    def choices(self) -> Mapping[str, str]:
        """Words among these parameters, such as a design's name."""
        ...

    @property
    def sensors(self) -> Sensors:
        """The sensors on the shaft."""
        ...

    @property
    def scene(self) -> Scene:
        """What is asked for when nothing else is."""
        ...

    @property
    def nominal_speed_rad_s(self) -> float:
        """The speed of the shaft [rad/s] at which errors and events are judged."""
        ...

    @property
    def missing_for_torque(self) -> tuple[str, ...]:
        """Parameters without which there is no torque."""
        ...

    @property
    def outputs(self) -> tuple[str, ...]:
        """Every output that can be asked for."""
        ...

    @property
    def shown_outputs(self) -> tuple[str, ...]:
        """The outputs that say most of it: its torque, and what its tools do."""
        ...

    @property
    def has_history(self) -> bool:
        """Whether its state depends on what went before, not on the shaft's state alone."""
        ...

    @property
    def tells_torque(self) -> bool:
        """Whether its balancing torque at a sample says what the shaft must give, without impulses between samples."""
        ...

    @property
    def tools(self) -> Mapping[str, str]:
        """The point whose way each measure tells, by the measure's name."""
        ...

    @property
    def joint_outputs(self) -> Mapping[str, tuple[str, str]]:
        """The outputs for position and velocity of each moving joint of the robot description, by its name."""
        ...

    def events(self) -> tuple[Event, ...]:
        """What happens over one turn, by shaft angle; of a machine with a history empty: they come with its motion."""
        ...

    def urdf(self) -> str:
        """The robot description (URDF)."""
        ...


SomeMachine = TypeVar("SomeMachine", bound=AnyMachine)


def with_encoder(machine: SomeMachine, settings: Mapping[str, float]) -> SomeMachine:
    """The machine with other settings of its encoder (see `ENCODER_OPTIONS`).

    Raises MachineError for values that an encoder cannot have.
    """
    if not settings:
        return machine
    encoder = replace(machine.sensors.encoder, **settings)  # type: ignore[arg-type]
    return replace(machine, sensors=replace(machine.sensors, encoder=encoder))
