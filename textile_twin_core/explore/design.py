"""A design on the page: a machine's family, the values that differ from it, speed, and what counts as dwell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from textile_twin_core.errors import SceneError
from textile_twin_core.machine import AnyMachine
from textile_twin_core.machine.sizes import check_size
from textile_twin_core.papers.beatup import WITHIN_M
from textile_twin_core.synthesis import Family, family_of
from textile_twin_core.synthesis.family import DeclaredFamily

_LARGEST_SPEED = 1e5


@dataclass(frozen=True)
class Design:
    """One design. `values` are the parameters that differ from the family's own, by name.

    `dwell_within_m` is how near the rear point a dwell counts, None for 5 % of the stroke.
    """

    family: Family
    speed_rad_s: float
    values: Mapping[str, float] = field(default_factory=dict)
    dwell_within_m: float | None = None

    @classmethod
    def of(cls, machine: AnyMachine) -> Design:
        """What a machine is, as it came."""
        return cls(family_of(machine), machine.nominal_speed_rad_s, {}, _own_dwell(machine))

    def fresh(self) -> Design:
        """What the machine was as it came."""
        return Design(self.family, self.family.base.nominal_speed_rad_s, {}, _own_dwell(self.family.base))

    @property
    def has_speed(self) -> bool:
        """Whether the shaft's speed stands beside the parameters; the needle transfer's is one of them."""
        return isinstance(self.family, DeclaredFamily) or not self.family.base.has_history

    def machine(self) -> AnyMachine:
        """The machine. Raises MachineError where these values make none."""
        return self.family.machine(self.values)

    def value(self, name: str) -> float | None:
        """A parameter's value; None where neither paper nor user gives one."""
        if name in self.values:
            return self.values[name]
        return next(p.value for p in self.family.parameters if p.name == name)

    def changed(self, values: Mapping[str, float]) -> Design:
        """With other values of parameters. Raises SceneError for a name or number that is none."""
        known = {p.name for p in self.family.parameters}
        for name, value in values.items():
            if name not in known:
                raise SceneError(f"machine '{self.family.name}' has no parameter '{name}'")
            check_number(value, name)
        return replace(self, values={**self.values, **{name: float(v) for name, v in values.items()}})

    def at_speed(self, speed_rad_s: float) -> Design:
        """At another shaft speed. Raises SceneError for a speed that is none."""
        check_number(speed_rad_s, "speed")
        if not 0.0 < speed_rad_s < _LARGEST_SPEED:
            raise SceneError(f"speed: must lie between 0 and {_LARGEST_SPEED * 30.0 / math.pi:.0f} rpm")
        return replace(self, speed_rad_s=float(speed_rad_s))

    def dwelling_within(self, within_m: float | None) -> Design:
        """With a dwell that counts within another distance. Raises SceneError for a distance that is none."""
        if within_m is not None:
            check_number(within_m, "dwell within")
            if not within_m > 0.0:
                raise SceneError("dwell within: must be a positive length")
        return replace(self, dwell_within_m=within_m)


def _own_dwell(machine: AnyMachine) -> float | None:
    """How near its rear point a machine's paper counts dwell [m]; None where it does not say."""
    return WITHIN_M if machine.name == "elliptic_gear_beatup" else None


def check_number(value: object, what: str) -> None:
    """Raise SceneError unless this is a number that a machine can have."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise SceneError(f"{what}: must be a number, not {value!r}")
    try:
        check_size(value, what)
    except Exception as error:
        raise SceneError(str(error)) from None
