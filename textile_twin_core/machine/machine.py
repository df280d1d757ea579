"""Machine: a linkage defined by its declaration, with lazily derived outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from textile_twin_core.machine.declaration import Declaration
from textile_twin_core.machine.elastic_outputs import elastic_outputs
from textile_twin_core.machine.events import Event, machine_events
from textile_twin_core.machine.linkage_row import linkage_row
from textile_twin_core.machine.model import MachineModel
from textile_twin_core.machine.sensors import Scene
from textile_twin_core.machine.sizes import computable
from textile_twin_core.machine.urdf import machine_urdf

_TORQUES = ("balancing_torque_Nm", "torque_inertial_Nm", "torque_gravity_Nm", "torque_load_Nm")


@dataclass(frozen=True)
class Machine(Declaration):
    """A machine with one degree of freedom: ground points, groups, bodies, loads, measures and sensors.

    Several equal linkages can be mounted on one shaft. Torque and energy are sums over the linkages; positions and
    reactions are those of the first.

    Attributes:
        name: name of the machine.
        points: ground points by name [m].
        groups: groups of the linkage, in the order in which they build on each other.
        bodies: masses on links, and flywheels on the main shaft.
        loads: what the machine works against.
        measures: displacements that get a name.
        gravity_m_s2: acceleration of gravity [m/s^2].
        sensors: encoder and torque sensor.
        linkages: phase and station of each linkage on the shaft.
        shaft: elastic main shaft with the linkages at its stations; None for a rigid shaft.
        tolerances: relative standard deviations of numbers by dotted path, such as `bodies.l3.mass_kg`.
        scene: default request.
        joint_names: joint names by link, where they differ from the link's name.
        angle_near_rad: angle per link [rad] that selects the turn of its printed angle.
        transmitted: output names of the torque that a link applies to an arm fixed to it, or a guide to its slider
            about the slider's start.
        missing_for_torque: parameters without which a machine of the catalogue has no torque.
        range_rad: range of the shaft angle over which the linkage must close [rad].
        nominal_speed_rad_s: shaft speed at which errors are judged [rad/s].
        parameters, choices: numeric and textual parameters of a machine of the catalogue.
        description: one line for lists.

    Raises:
        MachineError: with the shaft angle, if the linkage cannot close over `range_rad`.

    Examples:
        >>> import textile_twin_core as ttc
        >>> from textile_twin_core.mechanism import Crank, RRPDyad
        >>> crank = Crank("crank", "O", "A", 0.05)
        >>> rod = RRPDyad("rod", "slider", "A", "B", "C", (0.2, 0.1), (0.0, 0.0), (1.0, 0.0))
        >>> machine = ttc.Machine("press", points={"O": (0.0, 0.0)}, groups=(crank, rod))
        >>> machine.point_names
        ('O', 'A', 'B', 'C')
    """

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
        return (*(_TORQUES if self.has_complete_torque else ()), *moved) or self.outputs[:1]

    @property
    def has_history(self) -> bool:
        """False: a linkage has no history."""
        return False

    @property
    def has_complete_torque(self) -> bool:
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
