"""Parts of a contact model: bodies on a line, springs, one-sided stops, pads, and one driven element."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from textile_twin_core.arrays import FloatArray
from textile_twin_core.errors import ContactError

FRAME = "frame"
"""Name of the fixed end: the machine's frame, at position 0."""


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ContactError(message)


def _finite(owner: str, **values: float) -> None:
    for name, number in values.items():
        _require(math.isfinite(number), f"{owner}: {name} is {number!r}; give a finite number")


@dataclass(frozen=True)
class SlidingBody:
    """A rigid body that moves along the line, with a constant force on it (its weight, for instance)."""

    name: str
    mass_kg: float
    force_N: float = 0.0

    def __post_init__(self) -> None:
        _finite(f"body {self.name}", mass_kg=self.mass_kg, force_N=self.force_N)
        _require(self.mass_kg > 0.0, f"body {self.name}: mass_kg is {self.mass_kg}; it must be positive")


@dataclass(frozen=True)
class SpringDamper:
    """Linear spring and damper with the force -k (x_upper - x_lower - free) - b (v_upper - v_lower) on `upper`."""

    name: str
    lower: str
    upper: str
    stiffness_N_m: float
    damping_Ns_m: float = 0.0
    free_length_m: float = 0.0

    def __post_init__(self) -> None:
        owner = f"spring {self.name}"
        _finite(
            owner,
            stiffness_N_m=self.stiffness_N_m,
            damping_Ns_m=self.damping_Ns_m,
            free_length_m=self.free_length_m,
        )
        _require(self.stiffness_N_m >= 0.0, f"{owner}: stiffness_N_m is {self.stiffness_N_m}; it must not be negative")
        _require(self.damping_Ns_m >= 0.0, f"{owner}: damping_Ns_m is {self.damping_Ns_m}; it must not be negative")


@dataclass(frozen=True)
class Stop:
    """One-sided stop: x_upper - x_lower <= limit, with Newton's restitution (0 sticks, 1 loses no energy)."""

    name: str
    lower: str
    upper: str
    limit_m: float
    restitution: float = 0.0

    def __post_init__(self) -> None:
        owner = f"stop {self.name}"
        _finite(owner, limit_m=self.limit_m, restitution=self.restitution)
        _require(
            0.0 <= self.restitution <= 1.0, f"{owner}: restitution is {self.restitution}; it must lie between 0 and 1"
        )


@dataclass(frozen=True)
class Pad:
    """Elastic pad on `lower`, pressed by `upper` while c = x_upper - x_lower - position is positive.

    Its force is sum_k stiffness[k] c^(k+1) + b dc/dt. If a fast rebound makes the force negative, a pad that does not
    pull becomes slack until contact returns, and its elastic energy goes into its own damping. A pad that pulls sticks
    to the body while it is compressed.
    """

    name: str
    lower: str
    upper: str
    position_m: float
    stiffness: tuple[float, ...]
    """Coefficients of c, c^2, c^3, ... in N/m, N/m^2, N/m^3, ..."""
    damping_Ns_m: float = 0.0
    pulls: bool = False

    def __post_init__(self) -> None:
        owner = f"pad {self.name}"
        _finite(owner, position_m=self.position_m, damping_Ns_m=self.damping_Ns_m)
        _require(len(self.stiffness) > 0, f"{owner}: stiffness is empty; give at least the coefficient of c")
        _require(all(map(math.isfinite, self.stiffness)), f"{owner}: stiffness has a value that is not finite")
        first = self.stiffness[0]
        _require(first >= 0.0, f"{owner}: its first stiffness is {first}; it must not be negative")
        _require(self.damping_Ns_m >= 0.0, f"{owner}: damping_Ns_m is {self.damping_Ns_m}; it must not be negative")

    def force(self, compression: float) -> float:
        """Compute the elastic force [N] at a compression [m]."""
        total = 0.0
        for coefficient in reversed(self.stiffness):
            total = (total + coefficient) * compression
        return total

    def energy(self, compression: FloatArray) -> FloatArray:
        """Compute the elastic energy [J] at non-negative compressions [m]."""
        total = np.zeros_like(compression)
        for power, coefficient in reversed(list(enumerate(self.stiffness, start=1))):
            total = (total + coefficient / (power + 1)) * compression
        return np.asarray(total * compression)


@dataclass(frozen=True)
class ContactModel:
    """Bodies on a line between a driven element, whose motion is prescribed, and the frame.

    Raises:
        ContactError: for an unknown or repeated name.
    """

    drive: str
    bodies: tuple[SlidingBody, ...]
    springs: tuple[SpringDamper, ...] = ()
    stops: tuple[Stop, ...] = ()
    pads: tuple[Pad, ...] = ()
    index: dict[str, int] = field(init=False, repr=False, compare=False)
    """Row of every end: the bodies in their order, then the driven element, then the frame."""

    def __post_init__(self) -> None:
        ends = [*(body.name for body in self.bodies), self.drive, FRAME]
        for name in ends:
            _require(ends.count(name) == 1, f"the name {name!r} stands for two elements; give each its own")
        parts: tuple[SpringDamper | Stop | Pad, ...] = (*self.springs, *self.stops, *self.pads)
        names = [part.name for part in parts]
        for part in parts:
            _require(names.count(part.name) == 1, f"two springs, stops or pads are called {part.name!r}; rename one")
            for end in (part.lower, part.upper):
                _require(end in ends, f"{part.name}: no element is called {end!r}; there are {', '.join(ends)}")
            _require(part.lower != part.upper, f"{part.name}: both of its ends are {part.lower!r}")
        for stop in self.stops:
            _require(
                {stop.lower, stop.upper} != {self.drive, FRAME},
                f"stop {stop.name}: it stands between the driven element and the frame, so no body can give way",
            )
        object.__setattr__(self, "index", {name: row for row, name in enumerate(ends)})

    @property
    def movers(self) -> tuple[str, ...]:
        """Names of the moving ends: the bodies, then the driven element."""
        return (*(body.name for body in self.bodies), self.drive)
