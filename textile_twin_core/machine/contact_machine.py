"""A contact machine: bodies on springs and dampers between stops and pads, moved by an element on the shaft."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.contact import (
    ContactIntegrator,
    ContactModel,
    ContactRun,
    Pad,
    SlidingBody,
    SpringDamper,
    Stop,
    law_pieces,
    run_contact,
)
from textile_twin_core.errors import MachineError
from textile_twin_core.machine.declared import Declared
from textile_twin_core.machine.events import Event
from textile_twin_core.machine.sensors import Scene, Sensors
from textile_twin_core.machine.sizes import computable
from textile_twin_core.machine.urdf import contact_urdf
from textile_twin_core.mechanism.group import check_finite
from textile_twin_core.mechanism.law_strokes import Stroke, law_of_strokes
from textile_twin_core.mechanism.law_table import LiftTable
from textile_twin_core.mechanism.motion_law import TURN, MotionLaw

MOTION = ("position_m", "velocity_m_s", "acceleration_m_s2")
DRIVE = (
    "drive_force_N",
    "balancing_torque_Nm",
    "torque_inertial_Nm",
    "torque_gravity_Nm",
    "torque_load_Nm",
    "equivalent_inertia_kgm2",
    "kinetic_energy_J",
    "potential_energy_J",
)
"""What the drive must give between impacts: force on the driven element, its torque on the shaft (force times the
law's slope) with its parts (the element's own inertia; springs, dampers and stops), that inertia at the shaft, and the
energies of all bodies and springs. The inertia is the driven element's alone, mass times slope squared: where the
bodies are is no function of the shaft angle."""
_MOTION_OF_ALL = Scene(outputs=())
_MILLI = 1e3
_FASTEST_HZ = 3e6
"""Fastest rate of springs and dampers that is integrated within seconds."""


@dataclass(frozen=True)
class DrivenElement:
    """Element moved along the line by the shaft, with exactly one of `strokes`, a `table` or a `law`.

    With strokes, positions are counted from the place at shaft angle 0 [m]; with a table or law they are as given.

    Attributes:
        name: name of the element.
        strokes: strokes over one turn, each by a standard law.
        table: positions [m] at shaft angles [rad].
        law: law of motion.
        mass_kg: mass of the element [kg]; 0 leaves its inertia out of force and torque.
    """

    name: str
    strokes: tuple[Stroke, ...] = ()
    table: LiftTable | None = None
    law: MotionLaw | None = None
    mass_kg: float = 0.0

    def __post_init__(self) -> None:
        what = f"driven element '{self.name}'"
        if sum((bool(self.strokes), self.table is not None, self.law is not None)) != 1:
            raise MachineError(f"{what}: give its motion by one of strokes, table and law")
        if not 0.0 <= self.mass_kg < math.inf:
            raise MachineError(f"{what}: mass_kg must be zero or positive, not {self.mass_kg!r}")
        try:
            _ = self.motion
        except MachineError as error:
            raise MachineError(f"{what}: {error}") from None

    @cached_property
    def motion(self) -> MotionLaw:
        """Position over the shaft angle."""
        if self.law is not None:
            return self.law
        return law_of_strokes(self.strokes) if self.table is None else self.table.law


@dataclass(frozen=True)
class ContactMachine(Declared):
    """Bodies on a line, with springs, one-sided stops and pads between them, the frame and the driven element.

    Attributes:
        name: name of the machine.
        driven: element that the shaft moves, with its law of motion.
        bodies: bodies that slide on the line.
        springs, stops, pads: what acts between bodies, driven element and frame.
        start_m: positions of the bodies at shaft angle 0, at standstill [m]; 0 by default.
        axis: direction of the line in the machine's frame.
        sensors: encoder and torque sensor.
        scene: default request; without outputs it asks for the motion of all elements.
        nominal_speed_rad_s: shaft speed at which errors are judged [rad/s].
        parameters, choices: numeric and textual parameters of a machine of the catalogue.
        description: one line for lists.

    Raises:
        MachineError: for an unknown or repeated name, and for masses too light for their springs and dampers to be
            integrated.
        ContactError: for a start beyond a stop.

    Examples:
        >>> import textile_twin_core as ttc
        >>> run = ttc.machines.needle_transfer().simulate()
        >>> run.positions.shape[0]  # two bodies, then the driven element
        3
    """

    name: str
    driven: DrivenElement
    bodies: tuple[SlidingBody, ...]
    springs: tuple[SpringDamper, ...] = ()
    stops: tuple[Stop, ...] = ()
    pads: tuple[Pad, ...] = ()
    start_m: Mapping[str, float] = field(default_factory=dict)
    axis: tuple[float, float] = (1.0, 0.0)
    nominal_speed_rad_s: float = 10.0
    sensors: Sensors = field(default_factory=Sensors)
    scene: Scene = _MOTION_OF_ALL
    parameters: Mapping[str, float] = field(default_factory=dict)
    choices: Mapping[str, str] = field(default_factory=dict)
    description: str = ""

    def __repr__(self) -> str:
        return f"<ContactMachine '{self.name}': {', '.join(self.elements)}; {len(self.outputs)} outputs>"

    def __post_init__(self) -> None:
        for kept in ("start_m", "parameters", "choices"):
            object.__setattr__(self, kept, MappingProxyType(dict(getattr(self, kept))))
        what = f"machine '{self.name}'"
        if not (math.isfinite(self.nominal_speed_rad_s) and self.nominal_speed_rad_s > 0.0):
            raise MachineError(f"{what}: nominal_speed_rad_s must be positive, not {self.nominal_speed_rad_s!r}")
        if not 0.0 < math.hypot(*self.axis) < math.inf:
            raise MachineError(f"{what}: axis must be a finite vector that is not zero")
        names = [body.name for body in self.bodies]
        for body, place in self.start_m.items():
            check_finite(place, f"{what}: start_m of '{body}'")
            if body not in names:
                raise MachineError(f"{what}: start_m names '{body}'; bodies: {', '.join(names) or 'none'}")
        if not self.scene.outputs:
            moved = tuple(f"{element}_{motion}" for element in self.elements for motion in MOTION)
            scene = Scene(moved, self.scene.method, self.scene.tolerance)
            object.__setattr__(self, "scene", scene)
        self._check_stiffness()
        with computable(what):
            self.integrator().check(self.start)

    def _check_stiffness(self) -> None:
        """Raise MachineError for rates that need steps below a microsecond."""
        masses = {body.name: body.mass_kg for body in self.bodies}
        links = [(s.lower, s.upper, s.stiffness_N_m / _MILLI, s.damping_Ns_m) for s in self.springs]
        for pad in self.pads:
            at_one_mm = sum(abs(c) / _MILLI ** (power + 1) for power, c in enumerate(pad.stiffness))
            links.append((pad.lower, pad.upper, at_one_mm, pad.damping_Ns_m))
        for *ends, stiffness, damping in links:
            mass = min((masses[end] for end in ends if end in masses), default=math.inf)
            if max(damping / mass, math.sqrt(stiffness * _MILLI / mass)) > _FASTEST_HZ:
                raise MachineError(
                    f"machine '{self.name}': a mass of {mass:g} kg on {stiffness:g} N/mm and {damping:g} N s/m is too"
                    " stiff to be followed; look for a wrong unit"
                )

    @property
    def elements(self) -> tuple[str, ...]:
        """Moving elements: the driven element, then the bodies."""
        return (self.driven.name, *(body.name for body in self.bodies))

    @property
    def law(self) -> MotionLaw:
        """Position of the driven element over the shaft angle."""
        return self.driven.motion

    @property
    def start(self) -> tuple[float, ...]:
        """Positions of the bodies at shaft angle 0 [m]."""
        return tuple(self.start_m.get(body.name, 0.0) for body in self.bodies)

    @cached_property
    def model(self) -> ContactModel:
        """The integrator's contact model; rows are the bodies, then the driven element."""
        return ContactModel(self.driven.name, self.bodies, self.springs, self.stops, self.pads)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all outputs."""
        return (*(f"{element}_{motion}" for element in self.elements for motion in MOTION), *DRIVE)

    @property
    def shown_outputs(self) -> tuple[str, ...]:
        """Outputs named by the scene."""
        return self.scene.outputs

    @property
    def has_history(self) -> bool:
        """True: springs and stops depend on earlier samples."""
        return True

    @property
    def missing_for_torque(self) -> tuple[str, ...]:
        """Empty: a driven element without a mass has no inertia."""
        return ()

    @property
    def has_complete_torque(self) -> bool:
        """False: impacts act as impulses between samples."""
        return False

    @property
    def tools(self) -> Mapping[str, str]:
        """Empty: the elements are joints."""
        return {}

    @property
    def joint_outputs(self) -> Mapping[str, tuple[str, str]]:
        """Position and velocity of each element, by joint."""
        return {element: (f"{element}_position_m", f"{element}_velocity_m_s") for element in self.elements}

    def events(self) -> tuple[Event, ...]:
        """Empty: impacts and touches come with the motion, from `simulate` or a twin."""
        return ()

    def urdf(self) -> str:
        """Build the robot description (URDF): sliding elements with the limits of one cycle at nominal speed."""
        run = self.simulate(times=np.linspace(0.0, TURN / self.nominal_speed_rad_s, 4801))
        masses = {body.name: body.mass_kg for body in self.bodies} | {self.driven.name: self.driven.mass_kg}
        return contact_urdf(self.name, run, masses, self.axis)

    def integrator(self, tolerance: float = 1e-13) -> ContactIntegrator:
        """Return an integrator for the contact model."""
        return ContactIntegrator(self.model, tolerance)

    def simulate(
        self,
        end_s: float | None = None,
        times: FloatArray | None = None,
        speed_rad_s: float | None = None,
        tolerance: float = 1e-13,
    ) -> ContactRun:
        """Simulate at constant shaft speed from the declared start, theta = 0, to `end_s` (one cycle by default).

        Args:
            end_s: end of the run [s].
            times: times of the returned motion [s]; by default the ends of the integrator's own segments.
            speed_rad_s: shaft speed [rad/s]; nominal by default.
            tolerance: tolerance of the integrator.

        Returns:
            The run; rows are the bodies, then the driven element.

        Raises:
            ContactError: for times outside the run.
        """
        speed = self.nominal_speed_rad_s if speed_rad_s is None else speed_rad_s
        if end_s is None:
            end_s = TURN / abs(speed) if times is None else float(np.max(times))
        pieces = law_pieces(self.law, 0.0, end_s, (0.0, speed))
        return run_contact(self.integrator(tolerance), self.start, pieces, times)
