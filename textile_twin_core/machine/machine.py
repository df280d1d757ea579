"""Machine: a linkage defined by its declaration, with lazily derived outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from textile_twin_core.machine.declaration import Declaration
from textile_twin_core.machine.elastic_outputs import elastic_outputs
from textile_twin_core.machine.events import machine_events
from textile_twin_core.machine.linkage_row import linkage_row
from textile_twin_core.machine.model import MachineModel
from textile_twin_core.machine.protocol import Event
from textile_twin_core.machine.sensors import Scene
from textile_twin_core.machine.sizes import computable
from textile_twin_core.machine.urdf import machine_urdf

_TORQUES = ("balancing_torque_Nm", "torque_inertial_Nm", "torque_gravity_Nm", "torque_load_Nm")


@dataclass(frozen=True)
class Machine(Declaration):
    """A linkage machine (see Declaration), with its outputs, events and robot description."""

    __doc__ = Declaration.__doc__

    def __post_init__(self) -> None:
        super().__post_init__()
        with computable(f"machine '{self.name}'"):
            _ = self.model.outputs, self.model.first.reduction, self.model.first.load_torque
            # rejects a wrong declaration at once

    def __repr__(self) -> str:
        measures = f", measures {', '.join(measure.name for measure in self.measures)}" if self.measures else ""
        loads = f", {len(self.loads)} load{'s' * (len(self.loads) > 1)}" if self.loads else ""
        return f"<Machine '{self.name}': {len(self.links)} links{loads}{measures}; {len(self.outputs)} outputs>"

    @cached_property
    def model(self) -> MachineModel:
        """Expressions of all outputs, built on demand."""
        return MachineModel(self)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all outputs, including those of an elastic shaft."""
        return (*self.model.outputs, *elastic_outputs(self))

    @property
    def shown_outputs(self) -> tuple[str, ...]:
        """Outputs named by the scene, or else the torque with its parts and the measures."""
        if self.scene != Scene():
            return self.scene.outputs
        moved = [
            f"{m.name}_{what}" for m in self.measures for what in ("position_m", "velocity_m_s", "acceleration_m_s2")
        ]
        return (*(_TORQUES if self.tells_torque else ()), *moved) or self.outputs[:1]

    @property
    def has_history(self) -> bool:
        """False: a linkage has no history."""
        return False

    @property
    def tells_torque(self) -> bool:
        """True if all masses for the torque are declared."""
        return not self.missing_for_torque

    @property
    def joint_outputs(self) -> Mapping[str, tuple[str, str]]:
        """Outputs for position and velocity of each moving joint, by joint name."""
        names = [joint.name for joint in self.joints if joint.kind != "fixed"]
        stations = () if self.shaft is None else self.shaft.names
        own = {f"{name}{row.suffix}": f"joint_{name}{row.suffix}" for row in linkage_row(self) for name in names}
        return {name: (f"{output}_position", f"{output}_velocity") for name, output in own.items()} | {
            f"station_{name}": (f"station_{name}_angle_rad", f"station_{name}_speed_rad_s") for name in stations
        }

    def urdf(self) -> str:
        """Build the robot description (URDF) of the first linkage, or of all linkages on an elastic shaft."""
        return machine_urdf(self.model)

    def events(self) -> tuple[Event, ...]:
        """Return the events of one turn: start and end of loads, dead centres of measures."""
        return self._events

    @cached_property
    def _events(self) -> tuple[Event, ...]:
        return machine_events(self.model)
