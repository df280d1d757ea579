"""MachineModel: every output of a machine by name, as an expression built on demand."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from functools import cached_property, partial

from textile_twin_core.dynamics.body import Body
from textile_twin_core.dynamics.loads.load import LoadContext
from textile_twin_core.dynamics.reactions import balance, gather, inertia_force
from textile_twin_core.dynamics.reduction import Reduction, reduce_bodies
from textile_twin_core.dynamics.shaft_state import ShaftState
from textile_twin_core.errors import MachineError, SceneError
from textile_twin_core.expression import Expr, const, variable
from textile_twin_core.machine.declaration import Declaration
from textile_twin_core.machine.sensitivity import TorqueSensitivity
from textile_twin_core.mechanism import MAIN_SHAFT, Displacement, Motion
from textile_twin_core.mechanism.angles import link_angle
from textile_twin_core.mechanism.guide_line import GuideLine
from textile_twin_core.mechanism.joint import BASE, Joint
from textile_twin_core.mechanism.vector import Vector
from textile_twin_core.mechanism.wrenches import Wrenches

Builder = Callable[[], Expr]


class LinkageModel:
    """One linkage at its phase: motion, reduction, loads and reactions."""

    def __init__(self, machine: Declaration, number: int, shaft: ShaftState, loads_as_variables: bool = False) -> None:
        self.machine, self.number, self.shaft = machine, number, shaft
        self._loads_as_variables = loads_as_variables
        phase_rad = machine.linkages[number].phase_rad
        self.motion: Motion = machine.linkage.motion(phase_rad) if phase_rad else machine.linkage.solved
        self.gravity = Vector.of(*machine.gravity_m_s2)

    @cached_property
    def displacements(self) -> Mapping[str, Displacement]:
        """Displacement of every measure by name."""
        return {m.name: m.displacement(self.motion) for m in self.machine.measures}

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """Bodies of the linkage; those on the shaft itself belong to the first linkage."""
        return tuple(b for b in self.machine.bodies if self.number == 0 or not b.is_flywheel)

    @cached_property
    def load_context(self) -> LoadContext:
        """Inputs of the loads."""
        measures = {m.name: m for m in self.machine.measures}
        return LoadContext(self.motion, self.shaft, measures, self.displacements, self.number == 0)

    @cached_property
    def reduction(self) -> Reduction:
        """Bodies reduced to the shaft."""
        return reduce_bodies(self.motion, self.bodies, self.gravity)

    @cached_property
    def inertial_torque(self) -> Expr:
        """J alpha + J'/2 omega^2 [N m]."""
        reduced = self.reduction
        return reduced.inertia * self.shaft.alpha + reduced.half_slope * self.shaft.omega_squared

    @cached_property
    def load_torque(self) -> Expr:
        """Torque that the drive must add for the loads [N m]."""
        context = self.load_context
        forces = (load.unit_force(context) * self.intensity(i) for i, load in enumerate(self.machine.loads))
        return -total(forces)

    def intensity(self, number: int) -> Expr:
        """Return the intensity of a load of the machine."""
        if self._loads_as_variables:
            return self.intensity_variable(number)
        return self.machine.loads[number].intensity(self.load_context)

    def intensity_variable(self, number: int) -> Expr:
        """Return the variable that stands for a load's intensity."""
        return variable(f"load_{self.number}_{number}")

    @cached_property
    def wrenches(self) -> Wrenches:
        """Solved Newton-Euler equations."""
        wrenches = gather(self.motion, self.bodies, self.gravity, self.shaft)
        for i, load in enumerate(self.machine.loads):
            load.apply(self.load_context, wrenches, self.intensity(i))
        balance(self.machine.groups, wrenches)
        return wrenches


class MachineModel:
    """The outputs of a machine by name.

    Torque, inertia and energies are sums over the linkages on the shaft; other outputs are those of the first linkage.
    With `loads_as_variables` the loads' intensities remain variables, to be evaluated separately.
    """

    def __init__(self, machine: Declaration, shaft: ShaftState | None = None, loads_as_variables: bool = False) -> None:
        self.machine, self.shaft = machine, shaft or ShaftState()
        self.linkages = [
            LinkageModel(machine, number, self.shaft, loads_as_variables) for number in range(len(machine.linkages))
        ]
        self._builders: dict[str, Builder] = {}
        self._built: dict[str, Expr] = {}
        self._list_shaft_outputs()
        self._list_measures()
        self._list_reactions()
        self._list_links()
        self._list_points_and_joints()

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of all outputs."""
        return tuple(self._builders)

    @property
    def first(self) -> LinkageModel:
        """First linkage on the shaft."""
        return self.linkages[0]

    @cached_property
    def torque_sensitivity(self) -> TorqueSensitivity | None:
        """Sensitivity of the torque to the shaft's state; None for a machine without masses."""
        if self.machine.missing_for_torque:
            return None
        return TorqueSensitivity(self.output("balancing_torque_Nm"))

    def output(self, name: str) -> Expr:
        """Return the expression of an output. Raises SceneError, with near names, for an unknown one."""
        if name not in self._built:
            builder = self._builders.get(name)
            if builder is None:
                near = get_close_matches(name, self._builders, n=3) or list(self._builders)[:6]
                raise SceneError(
                    f"machine '{self.machine.name}' has no output '{name}'; did you mean {' or '.join(near)}?"
                )
            self._built[name] = builder()
        return self._built[name]

    def link_angle(self, name: str) -> Expr:
        """Express the angle of a link of the first linkage, continuous over the turn [rad]."""
        motion = self.first.motion
        near = self.machine.angle_near_rad.get(name, 0.0)
        return link_angle(motion.links[name], motion, near)

    def joint_state(self, joint: Joint) -> tuple[Expr, Expr]:
        """Express position and velocity of a joint [rad, rad/s or m, m/s]."""
        motion, omega = self.first.motion, self.shaft.omega
        child = motion.links[joint.child_link]
        if joint.kind == "prismatic":
            on = None if joint.parent_link == BASE else joint.parent_link
            line = GuideLine.of(motion, on, joint.origin_m, joint.axis, joint.name)
            slide, rate, _ = line.seen(motion.points[child.start]).along
            return slide, rate * omega
        if joint.parent_link == BASE:
            return self.link_angle(child.name), child.first * omega
        parent = motion.links[joint.parent_link]
        angle = self.link_angle(child.name) - self.link_angle(parent.name)
        return angle, (child.first - parent.first) * omega if joint.kind != "fixed" else const(0.0)

    def _offer(self, name: str, builder: Builder) -> None:
        if name in self._builders:
            raise MachineError(
                f"machine '{self.machine.name}': output '{name}' would mean two things; give the links, measures and "
                "joints that it may stand for names of their own"
            )
        self._builders[name] = builder

    def _list_shaft_outputs(self) -> None:
        parts: dict[str, Callable[[LinkageModel], Expr]] = {
            "balancing_torque_Nm": lambda k: k.inertial_torque + k.reduction.potential_slope + k.load_torque,
            "torque_inertial_Nm": lambda k: k.inertial_torque,
            "torque_gravity_Nm": lambda k: k.reduction.potential_slope,
            "torque_load_Nm": lambda k: k.load_torque,
            "balancing_torque_newton_euler_Nm": lambda k: -k.wrenches.torque_on[MAIN_SHAFT],
            "equivalent_inertia_kgm2": lambda k: k.reduction.inertia,
            "equivalent_inertia_slope_kgm2": lambda k: 2.0 * k.reduction.half_slope,
            "kinetic_energy_J": lambda k: 0.5 * k.reduction.inertia * self.shaft.omega_squared,
            "potential_energy_J": lambda k: k.reduction.potential,
        }
        for name, part in parts.items():
            self._offer(name, partial(self._sum, part))

    def _list_measures(self) -> None:
        for measure in self.machine.measures:
            get = partial(self.first.displacements.__getitem__, measure.name)
            self._offer(f"{measure.name}_position_m", partial(_position, get))
            self._offer(f"{measure.name}_velocity_m_s", partial(_velocity, get, self.shaft))
            self._offer(f"{measure.name}_acceleration_m_s2", partial(_acceleration, get, self.shaft))

    def _list_reactions(self) -> None:
        for output, arm in self.machine.transmitted.items():
            self._offer(output, partial(self._wrench, lambda w, arm: w.transmitted[arm], arm))
        for pin in self.machine.linkage.pins:
            self._offer(f"reaction_{pin}_x_N", partial(self._wrench, lambda w, p: w.reactions[p].x, pin))
            self._offer(f"reaction_{pin}_y_N", partial(self._wrench, lambda w, p: w.reactions[p].y, pin))
        sliders = [joint.child_link for joint in self.machine.joints if joint.kind == "prismatic"]
        for slider in sliders:
            name = "reaction_guide_N" if len(sliders) == 1 else f"reaction_guide_{slider}_N"
            self._offer(name, partial(self._wrench, lambda w, s: w.guide_reactions[s], slider))
        for contact in (c for group in self.machine.groups for c in group.contact_forces):
            self._offer(contact.output, partial(self._wrench, lambda w, c: w.contacts[c], contact.output))

    def _list_links(self) -> None:
        for name in self.first.motion.links:
            k = link_number(name)
            self._offer(f"theta_{k}_rad", partial(self.link_angle, name))
            self._offer(f"omega_{k}_rad_s", partial(self._link_speed, name))
            self._offer(f"alpha_{k}_rad_s2", partial(self._link_acceleration, name))
            self._offer(f"inertia_force_{k}_x_N", partial(self._inertia, name, lambda f, _: f.x))
            self._offer(f"inertia_force_{k}_y_N", partial(self._inertia, name, lambda f, _: f.y))
            self._offer(f"inertia_torque_{k}_Nm", partial(self._inertia, name, lambda _, couple: couple))

    def _list_points_and_joints(self) -> None:
        for name in self.first.motion.points:
            self._offer(f"point_{name}_x_m", partial(self._coordinate, name, "x"))
            self._offer(f"point_{name}_y_m", partial(self._coordinate, name, "y"))
        for name, quantity in self.first.motion.quantities.items():
            self._offer(name, partial(_itself, quantity))
        for joint in self.machine.joints:
            if joint.kind != "fixed":
                self._offer(f"joint_{joint.name}_position", partial(self._joint, joint, 0))
                self._offer(f"joint_{joint.name}_velocity", partial(self._joint, joint, 1))

    def _check_masses(self) -> None:
        if self.machine.missing_for_torque:
            raise MachineError(
                f"machine '{self.machine.name}' lacks masses for torque, energy and reactions; "
                f"give {', '.join(self.machine.missing_for_torque)}"
            )

    def _sum(self, part: Callable[[LinkageModel], Expr]) -> Expr:
        self._check_masses()
        return total(part(linkage) for linkage in self.linkages)

    def _wrench(self, pick: Callable[[Wrenches, str], Expr], name: str) -> Expr:
        self._check_masses()
        return pick(self.first.wrenches, name)

    def _link_speed(self, name: str) -> Expr:
        return self.first.motion.links[name].first * self.shaft.omega

    def _link_acceleration(self, name: str) -> Expr:
        link = self.first.motion.links[name]
        return link.second * self.shaft.omega_squared + link.first * self.shaft.alpha

    def _inertia(self, link: str, pick: Callable[[Vector, Expr], Expr]) -> Expr:
        self._check_masses()
        bodies = [b for b in self.machine.bodies if b.on == link]
        return total(pick(*inertia_force(self.first.motion, body, self.shaft)) for body in bodies)

    def _coordinate(self, point: str, axis: str) -> Expr:
        position = self.first.motion.points[point].position
        return position.x if axis == "x" else position.y

    def _joint(self, joint: Joint, which: int) -> Expr:
        return self.joint_state(joint)[which]


def _itself(quantity: Expr) -> Expr:
    return quantity


def _position(get: Callable[[], Displacement]) -> Expr:
    return get().position


def _velocity(get: Callable[[], Displacement], shaft: ShaftState) -> Expr:
    return get().first * shaft.omega


def _acceleration(get: Callable[[], Displacement], shaft: ShaftState) -> Expr:
    displacement = get()
    return displacement.second * shaft.omega_squared + displacement.first * shaft.alpha


def link_number(link: str) -> str:
    """Return the K of theta_K_rad: the number in a name such as l3, else the whole name."""
    return link[1:] if link[:1] == "l" and link[1:].isdigit() else link


def total(terms: Iterable[Expr]) -> Expr:
    """Sum expressions."""
    result = const(0.0)
    for term in terms:
        result += term
    return result
