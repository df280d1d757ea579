"""Machine files that are wrong in one number of a body or length, or off within their tolerances.

The recording's truth is that of `mill_recordings`, by equations of its own; here only the file changes.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import Case
from textile_twin_core.errors import MachineError
from textile_twin_core.inference.priors import WorkingPoint, parameters
from textile_twin_core.machine import Machine
from textile_twin_core.machine.slots import read, slots, write

MISTAKES = {"mass_kg": (0.1, 0.3), "inertia_kgm2": (0.1, 0.3), "centroid_along": (0.1, 0.3), "length_m": (0.01, 0.02)}
SPRING_MISTAKES = {"stiffness_N_m": (0.35, 0.35)}
"""Relative size of a mistake, by the end of the number's name; and those of a machine with a spring."""
_OFF = ("mass", "inertia", "centroid", "length", "ground", "force", "spring")


def wrong_files(case: Case) -> Iterator[tuple[str, float, Machine]]:
    """One file for each kind of mistake: path of the wrong number, the factor on it, and the machine of the file."""
    rng = np.random.default_rng([case.seed, 99])
    machine = configured_machine(case)
    values, paths = read(machine), {slot.name: slot.path for slot in slots(machine)}
    for what, (least, most) in (SPRING_MISTAKES if case.spring else MISTAKES).items():
        name = str(rng.choice([each for each in values if each.endswith(what) and values[each]]))
        factor = 1.0 + float(rng.uniform(least, most) * rng.choice([-1.0, 1.0]))
        try:
            wrong = write(machine, {name: factor * values[name]})
        except MachineError:
            continue  # this linkage does not close
        assert isinstance(wrong, Machine)
        yield paths[name], factor, wrong


def off_within_tolerances(case: Case) -> Machine:
    """The file with every number of bodies, lengths, points and forces off by its everyday tolerance."""
    rng = np.random.default_rng([case.seed, 5])
    machine = configured_machine(case)
    known, held = parameters(machine, WorkingPoint(1.0, 1.0, 1.0))
    values = read(machine)
    moved = {
        held[p.name].name: values[held[p.name].name] + p.tolerance * float(rng.standard_normal())
        for p in known
        if p.name in held and p.kind in _OFF
    }
    off = write(machine, moved)
    assert isinstance(off, Machine)
    return off
