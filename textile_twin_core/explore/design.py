"""Design on the page: design family of the machine, changed values, speed, and tolerance of a dwell."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from textile_twin_core.dynamics.loads import ForceCurve
from textile_twin_core.errors import SceneError
from textile_twin_core.machine import AnyMachine, Machine
from textile_twin_core.machine.sizes import check_size
from textile_twin_core.papers.beatup import WITHIN_M
from textile_twin_core.synthesis import Family, family_of
from textile_twin_core.synthesis.family import DeclaredFamily

_LARGEST_SPEED = 1e5


@dataclass(frozen=True)
class Design:
    """Design of a machine.

    Attributes:
        family: Family of the machine.
        speed_rad_s: Speed of the shaft [rad/s].
        values: Parameters that differ from those of the family, by name.
        dwell_within_m: Distance from the rear point that counts as dwell [m]; None for 5 % of the stroke.
        declared: Family before its force curves were changed; None while they are as declared.
    """

    family: Family
    speed_rad_s: float
    values: Mapping[str, float] = field(default_factory=dict)
    dwell_within_m: float | None = None
    declared: Family | None = None

    @classmethod
    def of(cls, machine: AnyMachine) -> Design:
        """Create the design of a machine as declared."""
        return cls(family_of(machine), machine.nominal_speed_rad_s, {}, _own_dwell(machine))

    def fresh(self) -> Design:
        """Return the design as declared, without changes."""
        family = self.declared or self.family
        return Design(family, family.base.nominal_speed_rad_s, {}, _own_dwell(family.base))

    @property
    def has_speed(self) -> bool:
        """True if the shaft speed is separate from the parameters; in the needle transfer it is one of them."""
        return isinstance(self.family, DeclaredFamily) or not self.family.base.has_history

    def machine(self) -> AnyMachine:
        """Build the machine.

        Raises:
            MachineError: The values give no valid machine.
        """
        return self.family.machine(self.values)

    def value(self, name: str) -> float | None:
        """Return the value of a parameter; None where neither paper nor user gives one."""
        if name in self.values:
            return self.values[name]
        return next(p.value for p in self.family.parameters if p.name == name)

    def changed(self, values: Mapping[str, float]) -> Design:
        """Return the design with other values of parameters.

        Raises:
            SceneError: A name is unknown or a value is not a number.
        """
        known = {p.name for p in self.family.parameters}
        for name, value in values.items():
            if name not in known:
                raise SceneError(f"machine '{self.family.name}' has no parameter '{name}'")
            check_number(value, name)
        return replace(self, values={**self.values, **{name: float(v) for name, v in values.items()}})

    @property
    def curves(self) -> tuple[ForceCurve, ...]:
        """Force curves of the machine."""
        return force_curves(self.family)

    def with_curve(self, name: str, in_N: Sequence[float], out_N: Sequence[float] | None) -> Design:
        """Return the design with other forces at the knots of a force curve.

        Raises:
            SceneError: There is no such curve, or a value is not a number.
            MachineError: The values do not fit the knots.
        """
        base = self.family.base
        if name not in (curve.name for curve in self.curves):
            raise SceneError(f"machine '{self.family.name}' has no force curve '{name}'")
        assert isinstance(base, Machine)
        for value in (*in_N, *(out_N or ())):
            check_number(value, f"force of {name}")
        ways = tuple(map(float, in_N)), None if out_N is None else tuple(map(float, out_N))
        loads = tuple(
            replace(load, in_N=ways[0], out_N=ways[1]) if isinstance(load, ForceCurve) and load.name == name else load
            for load in base.loads
        )
        return replace(self, family=DeclaredFamily(replace(base, loads=loads)), declared=self.declared or self.family)

    def at_speed(self, speed_rad_s: float) -> Design:
        """Return the design at another shaft speed.

        Raises:
            SceneError: The speed is not valid.
        """
        check_number(speed_rad_s, "speed")
        if not 0.0 < speed_rad_s < _LARGEST_SPEED:
            raise SceneError(f"speed: must lie between 0 and {_LARGEST_SPEED * 30.0 / math.pi:.0f} rpm")
        return replace(self, speed_rad_s=float(speed_rad_s))

    def dwelling_within(self, within_m: float | None) -> Design:
        """Return the design with another tolerance of the dwell.

        Raises:
            SceneError: The distance is not valid.
        """
        if within_m is not None:
            check_number(within_m, "dwell within")
            if not within_m > 0.0:
                raise SceneError("dwell within: must be a positive length")
        return replace(self, dwell_within_m=within_m)


def force_curves(family: Family) -> tuple[ForceCurve, ...]:
    """List the force curves of a family's machine."""
    loads = family.base.loads if isinstance(family.base, Machine) else ()
    return tuple(load for load in loads if isinstance(load, ForceCurve))


def _own_dwell(machine: AnyMachine) -> float | None:
    """Return the tolerance of a dwell in the paper of a machine [m]; None where it states none."""
    return WITHIN_M if machine.name == "elliptic_gear_beatup" else None


def check_number(value: object, what: str) -> None:
    """Raise SceneError unless this is a number within the limits of a machine."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SceneError(f"{what}: must be a number, not {value!r}")
    try:
        check_size(value, what)
    except Exception as error:
        raise SceneError(str(error)) from None
