"""MachineModel: every output of a machine by its name, as an expression, built only when asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from functools import cached_property
from typing import TYPE_CHECKING

from textile_twin_core.dynamics.loads.load import LoadContext, generalised_force
from textile_twin_core.dynamics.reactions import balance, gather, inertia_force
from textile_twin_core.dynamics.reduction import Reduction, reduce_bodies
from textile_twin_core.dynamics.shaft_state import ShaftState
from textile_twin_core.dynamics.wrenches import Wrenches
from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.expression import Expr, const
from textile_twin_core.mechanism import MAIN_SHAFT, Displacement, Motion, RRPDyad
from textile_twin_core.mechanism.angles import link_angle
from textile_twin_core.mechanism.vector import Vector

if TYPE_CHECKING:
    from textile_twin_core.machines.machine import Machine

Builder = Callable[[], Expr]
TORQUE_OUTPUTS = ("balancing_torque_Nm", "torque_inertial_Nm", "torque_gravity_Nm", "torque_load_Nm")


class LinkageModel:
    """One linkage at its phase: motion, reduction, loads and reactions."""

    def __init__(self, machine: Machine, phase_rad: float, shaft: ShaftState) -> None:
        self.machine, self.shaft = machine, shaft
        self.motion: Motion = machine.linkage.motion(phase_rad)
        self.gravity = Vector.of(*machine.gravity_m_s2)

    @cached_property
    def displacements(self) -> Mapping[str, Displacement]:
        """Displacement of every measure by name."""
        return {m.name: m.displacement(self.motion) for m in self.machine.measures}

    @cached_property
    def load_context(self) -> LoadContext:
        """What loads act on."""
        measures = {m.name: m for m in self.machine.measures}
        return LoadContext(self.motion, self.shaft, measures, self.displacements)

    @cached_property
    def reduction(self) -> Reduction:
        """The bodies as the shaft feels them."""
        return reduce_bodies(self.motion, self.machine.bodies, self.gravity)

    @cached_property
    def load_torque(self) -> Expr:
        """What the drive must add for the loads [N m]."""
        total = const(0.0)
        for load in self.machine.loads:
            total -= generalised_force(load, self.load_context)
        return total

    @cached_property
    def wrenches(self) -> Wrenches:
        """Newton-Euler's equations, solved."""
        wrenches = gather(self.motion, self.machine.bodies, self.gravity, self.shaft)
        for load in self.machine.loads:
            load.apply(self.load_context, wrenches)
        balance(self.machine.groups, wrenches)
        return wrenches


class MachineModel:
    """The outputs of a machine by name.

    Torque, inertia and energies are sums over the linkages on the shaft; all else speaks of the first.
    """

    def __init__(self, machine: Machine, shaft: ShaftState | None = None) -> None:
        self.machine, self.shaft = machine, shaft or ShaftState()
        self._linkages = [LinkageModel(machine, place.phase_rad, self.shaft) for place in machine.linkages]
        self._builders = self._catalogue()
        self._built: dict[str, Expr] = {}

    @property
    def outputs(self) -> tuple[str, ...]:
        """All output names."""
        return tuple(self._builders)

    def output(self, name: str) -> Expr:
        """The expression of an output. Raises SceneError, with near names, for an unknown one."""
        if name not in self._built:
            builder = self._builders.get(name)
            if builder is None:
                near = get_close_matches(name, self._builders, n=3) or list(self._builders)[:6]
                raise SceneError(
                    f"machine '{self.machine.name}' has no output '{name}'; did you mean {' or '.join(near)}?"
                )
            self._built[name] = builder()
        return self._built[name]

    @property
    def first(self) -> LinkageModel:
        """The first linkage on the shaft."""
        return self._linkages[0]

    def _sum(self, part: Callable[[LinkageModel], Expr]) -> Expr:
        total = const(0.0)
        for linkage in self._linkages:
            total += part(linkage)
        return total

    def _dynamic(self, part: Callable[[LinkageModel], Expr]) -> Builder:
        def build() -> Expr:
            if self.machine.missing_for_torque:
                raise MachineError(
                    f"machine '{self.machine.name}' has no masses, so no torque, energy or reaction; "
                    f"give {', '.join(self.machine.missing_for_torque)}"
                )
            return self._sum(part)

        return build

    def _inertial(self, linkage: LinkageModel) -> Expr:
        r = linkage.reduction
        return r.inertia * self.shaft.alpha + r.half_slope * self.shaft.omega_squared

    def _catalogue(self) -> dict[str, Builder]:
        found: dict[str, Builder] = {}
        dynamic = self._dynamic
        found["balancing_torque_Nm"] = dynamic(
            lambda k: self._inertial(k) + k.reduction.potential_slope + k.load_torque
        )
        found["torque_inertial_Nm"] = dynamic(self._inertial)
        found["torque_gravity_Nm"] = dynamic(lambda k: k.reduction.potential_slope)
        found["torque_load_Nm"] = dynamic(lambda k: k.load_torque)
        found["balancing_torque_newton_euler_Nm"] = dynamic(lambda k: -k.wrenches.torque_on[MAIN_SHAFT])
        found["equivalent_inertia_kgm2"] = dynamic(lambda k: k.reduction.inertia)
        found["equivalent_inertia_slope_kgm2"] = dynamic(lambda k: 2.0 * k.reduction.half_slope)
        found["kinetic_energy_J"] = dynamic(lambda k: 0.5 * k.reduction.inertia * self.shaft.omega_squared)
        found["potential_energy_J"] = dynamic(lambda k: k.reduction.potential)
        self._add_measures(found)
        for output, arm in self.machine.transmitted.items():
            found[output] = self._first(lambda k, arm=arm: k.wrenches.transmitted[arm])
        self._add_reactions(found)
        self._add_links(found)
        self._add_points(found)
        self._add_joints(found)
        return found

    def _first(self, part: Callable[[LinkageModel], Expr]) -> Builder:
        def build() -> Expr:
            if self.machine.missing_for_torque:
                return self._dynamic(part)()
            return part(self.first)

        return build

    def _add_measures(self, found: dict[str, Builder]) -> None:
        shaft = self.shaft
        for measure in self.machine.measures:

            def get(name: str = measure.name) -> Displacement:
                return self.first.displacements[name]

            name = measure.name
            found[f"{name}_position_m"] = lambda get=get: get().position
            found[f"{name}_velocity_m_s"] = lambda get=get: get().first * shaft.omega
            found[f"{name}_acceleration_m_s2"] = lambda get=get: (
                get().second * shaft.omega_squared + get().first * shaft.alpha
            )

    def _add_reactions(self, found: dict[str, Builder]) -> None:
        for pin in pins(self.machine):
            found[f"reaction_{pin}_x_N"] = self._first(lambda k, pin=pin: k.wrenches.reactions[pin].x)
            found[f"reaction_{pin}_y_N"] = self._first(lambda k, pin=pin: k.wrenches.reactions[pin].y)
        sliders = [g.slider for g in self.machine.groups if isinstance(g, RRPDyad)]
        for slider in sliders:
            name = "reaction_guide_N" if len(sliders) == 1 else f"reaction_guide_{slider}_N"
            found[name] = self._first(lambda k, s=slider: k.wrenches.guide_reactions[s])

    def _add_links(self, found: dict[str, Builder]) -> None:
        shaft = self.shaft
        for name, link in self.first.motion.links.items():
            number = link_number(name)
            found[f"theta_{number}_rad"] = lambda name=name: self.link_angle(name)
            found[f"omega_{number}_rad_s"] = lambda link=link: link.first * shaft.omega
            found[f"alpha_{number}_rad_s2"] = lambda link=link: (
                link.second * shaft.omega_squared + link.first * shaft.alpha
            )
            bodies = [b for b in self.machine.bodies if b.on == name]
            found[f"inertia_force_{number}_x_N"] = self._first(
                lambda k, bodies=bodies: _total([inertia_force(k.motion, b, shaft)[0].x for b in bodies])
            )
            found[f"inertia_force_{number}_y_N"] = self._first(
                lambda k, bodies=bodies: _total([inertia_force(k.motion, b, shaft)[0].y for b in bodies])
            )
            found[f"inertia_torque_{number}_Nm"] = self._first(
                lambda k, bodies=bodies: _total([inertia_force(k.motion, b, shaft)[1] for b in bodies])
            )

    def _add_points(self, found: dict[str, Builder]) -> None:
        for name, point in self.first.motion.points.items():
            found[f"point_{name}_x_m"] = lambda point=point: point.position.x
            found[f"point_{name}_y_m"] = lambda point=point: point.position.y

    def _add_joints(self, found: dict[str, Builder]) -> None:
        for name in self.machine.joint_names.values():
            found[f"joint_{name}_position"] = lambda name=name: self.joint(name)[0]
            found[f"joint_{name}_velocity"] = lambda name=name: self.joint(name)[1]

    def joint(self, name: str) -> tuple[Expr, Expr]:
        """Position and velocity of a joint of the robot description [rad, rad/s or m, m/s]."""
        from textile_twin_core.machines.joints import joint_state

        joint = next(j for j in self.machine.joints if j.name == name)
        return joint_state(self, joint)

    def link_angle(self, name: str) -> Expr:
        """The angle of a link of the first linkage, continuous over the turn [rad]."""
        motion = self.first.motion
        near = self.machine.angle_near_rad.get(name, 0.0)
        return link_angle(motion.links[name], motion.rotations[MAIN_SHAFT].direction, near)


def pins(machine: Machine) -> tuple[str, ...]:
    """The turning joints of a machine, by point, in the order of the groups."""
    found: dict[str, None] = {}
    for group in machine.groups:
        for attribute in ("at", "ground", "from_point", "end"):
            point = getattr(group, attribute, None)
            if isinstance(point, str):
                found[point] = None
    loose = _loose_ends(machine)
    return tuple(p for p in found if p not in loose)


def _loose_ends(machine: Machine) -> set[str]:
    """Ends of cranks and arms on which nothing hangs: no joint there."""
    ends = {g.end for g in machine.groups if hasattr(g, "end") and not hasattr(g, "from_point")}
    used = {getattr(g, a) for g in machine.groups for a in ("from_point", "ground", "at") if hasattr(g, a)}
    return ends - used


def link_number(link: str) -> str:
    """The K of theta_K_rad: the number in names such as l3, else the whole name."""
    return link[1:] if link[:1] == "l" and link[1:].isdigit() else link


def _total(terms: list[Expr]) -> Expr:
    total = const(0.0)
    for term in terms:
        total += term
    return total
