"""Chosen numbers of a machine file, estimated from recordings whose truth is computed without the engine."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import healthy, record
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.file_numbers import identify_numbers
from textile_twin_core.errors import SceneError

MASS = "bodies.l3.mass_kg"


@pytest.mark.slow
def test_a_mass_that_is_wrong_in_the_file_is_estimated_with_the_file_exact_and_within_tolerances() -> None:
    case = healthy("loom", 921)
    made, true = record(case), configured_machine(case)
    right = next(body.mass_kg for body in true.bodies if body.on == "l3")
    bodies = tuple(replace(body, mass_kg=1.25 * body.mass_kg) if body.on == "l3" else body for body in true.bodies)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = identify_numbers(readings, replace(true, bodies=bodies), [MASS])
    tolerant, exact = found.parameters[MASS], found.given_file[MASS]
    assert exact.value == pytest.approx(right, abs=min(4.0 * exact.sigma, 0.03 * right))
    assert tolerant.value == pytest.approx(right, abs=3.0 * tolerant.sigma)
    assert exact.sigma < tolerant.sigma < 0.25 * right
    assert found.nominal[MASS] == 1.25 * right
    written = next(body.mass_kg for body in found.machine.bodies if body.on == "l3")
    assert written == pytest.approx(tolerant.value)
    with pytest.raises(SceneError, match=r"bodies\.l3\.mass_kg"):
        identify_numbers(readings, true, ["bodies.l3.mass"])
