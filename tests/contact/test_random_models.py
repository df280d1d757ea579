"""Random bodies, springs, stops and pads between a shaken drive and the frame: no stop is passed, no energy is lost."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest

from textile_twin_core.contact import (
    FRAME,
    ContactError,
    ContactIntegrator,
    ContactModel,
    ContactRun,
    DrivePiece,
    Pad,
    SlidingBody,
    SpringDamper,
    Stop,
    run_contact,
)
from textile_twin_core.contact.run import sample
from textile_twin_core.mechanism.motion_law import Section


def random_model(random: np.random.Generator) -> tuple[ContactModel, np.ndarray]:
    """Draw up to three bodies with random parts between any two ends; many stops are closed at the start."""
    count = int(random.integers(1, 4))
    bodies = tuple(
        SlidingBody(f"b{k}", 10 ** random.uniform(-2, 0), random.normal() * (random.random() < 0.5))
        for k in range(count)
    )
    start = np.cumsum(random.uniform(0.01, 0.05, count))
    ends = ["drive", *(body.name for body in bodies), FRAME]
    place = dict(zip(ends, [0.0, *start.tolist(), 0.0], strict=True))

    def pair() -> tuple[str, str]:
        lower, upper = random.choice(len(ends), 2, replace=False)
        return ends[lower], ends[upper]

    springs = []
    for k in range(int(random.integers(0, count + 2))):
        lower, upper = pair()
        damping = float(random.choice([0.0, 10 ** random.uniform(-2, 1)]))
        free = place[upper] - place[lower] + random.normal() * 0.01
        springs.append(SpringDamper(f"s{k}", lower, upper, 10 ** random.uniform(0, 4), damping, free))
    stops = []
    for k in range(int(random.integers(1, count + 3))):
        lower, upper = pair()
        if {lower, upper} != {"drive", FRAME}:
            limit = place[upper] - place[lower] + float(random.choice([0.0, random.uniform(0.0, 0.01)]))
            stops.append(Stop(f"t{k}", lower, upper, limit, float(random.choice([0.0, 0.3, 0.6, 0.9]))))
    body = ends[int(random.integers(1, count + 1))]
    pad = Pad(
        "pad",
        FRAME,
        body,
        place[body] + random.uniform(-0.001, 0.01),
        (10 ** random.uniform(2, 6), 0.0, 10 ** random.uniform(5, 11)),
        float(random.choice([0.0, 10 ** random.uniform(-1, 1.5)])),
        bool(random.integers(2)),
    )
    return ContactModel("drive", bodies, tuple(springs), tuple(stops), (pad,)), start


_END_S = 0.4


def random_run(seed: int) -> Callable[[], ContactRun]:
    """Return runs of such a model, thrown at its stops while the drive shakes, with one integrator."""
    random = np.random.default_rng(seed)
    model, start = random_model(random)
    frequency, amplitude = 2 * math.pi * random.uniform(1, 30), 10 ** random.uniform(-4, -2)
    pieces = [DrivePiece(0.0, _END_S, Section((0.0,), amplitude, frequency), (0.0, 1.0))]
    speeds = random.normal(size=start.size) * 0.3
    integrator = ContactIntegrator(model, 1e-12, 3000)
    return lambda: run_contact(integrator, start, pieces, velocities_m_s=speeds)


@pytest.mark.parametrize("seed", range(60))
def test_no_stop_is_passed_and_energy_closes(seed: int) -> None:
    try:
        run = random_run(seed)()
    except ContactError as error:
        # a body between drive and frame can be jammed, or bounce faster and faster
        assert "jam a body" in str(error) or "no end" in str(error)
        return
    assert run.energies.imbalance < 1e-11
    positions = np.vstack((sample(run.segments, np.linspace(0.0, _END_S, 2001))[0], np.zeros(2001)))
    index = run.model.index
    for stop in run.model.stops:
        gap = stop.limit_m - positions[index[stop.upper]] + positions[index[stop.lower]]
        assert gap.min() > -1e-13


def test_a_log_that_is_given_more_room_tells_the_same() -> None:
    stretches, events = 0, 0
    for seed in range(12):
        again = random_run(seed)
        with suppress(ContactError):
            run, with_room = again(), again()
            assert with_room.events == run.events
            np.testing.assert_array_equal(with_room.positions, run.positions)
            stretches, events = max(stretches, len(run.segments)), max(events, len(run.events))
    assert stretches > 16 and events > 16  # more than the initial capacity
