"""Names of mistakes, in recordings of two machines whose truth is computed without the engine."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.campaign import more
from tests.generators.configured_machine import configured_machine
from tests.generators.mill_recordings import Case, MillRecording, healthy, mistaken, record
from textile_twin_core.comparison import Assessment, Readings, assess, calibrate, identify
from textile_twin_core.comparison.causes import without_law
from textile_twin_core.errors import RecordingError
from textile_twin_core.inference.parameter import GAIN, HIGH_PASS, gain_factor
from textile_twin_core.machines import create
from textile_twin_core.recordings.prediction import recompute
from textile_twin_core.recordings.samples import AngleSamples


def judged(case: Case, made: MillRecording | None = None) -> Assessment:
    made = made or record(case)
    return assess(
        Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque), configured_machine(case)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("run_up", "machine"), [(True, "tufting"), (False, "loom"), *more((True, "loom"), (False, "tufting"))]
)
def test_nothing_is_said_of_a_healthy_recording(machine: str, run_up: bool) -> None:
    found = judged(healthy(machine, 901, run_up=run_up, duration_s=18.0))
    assert [cause.text for cause in found.verdict] == []
    assert found.explained > 0.99


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.8, *more(1.25)])
def test_a_rocker_of_another_mass_is_named_or_an_equivalent_and_no_sensor_is_accused(mass: float) -> None:
    case = healthy("loom", 911, duration_s=14.0)
    made, machine = record(case), configured_machine(case)
    bodies = tuple(
        replace(body, mass_kg=mass * body.mass_kg, inertia_kgm2=mass * body.inertia_kgm2) if body.on == "l3" else body
        for body in machine.bodies
    )
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    declared = replace(machine, bodies=bodies)
    found = calibrate(readings, declared)
    named = {path for cause in found.assessment.verdict for path in (cause.parameter, *cause.equivalents)}
    assert any("l3" in path for path in named)
    assert not any(path.startswith("sensors.") for path in named)
    assert found.gain.value == pytest.approx(1.0, abs=3.0 * found.gain.sigma)
    identified = identify(readings, declared)  # with the file as it is
    assert identified.unmodelled.significant


@pytest.mark.campaign
def test_what_is_too_small_to_be_named_is_no_torque_that_repeats() -> None:
    """Gain and zero at half of the threshold, which leave 1 % of the torque by angle."""
    case = healthy("tufting", 912, duration_s=18.0)
    encoder = replace(case.encoder, zero_rad=math.radians(0.2))
    found = judged(replace(case, encoder=encoder, torque=replace(case.torque, gain=1.012)))
    assert found.verdict == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "names", "run_up"),
    [
        ("tufting", ("direction",), True),
        ("loom", ("newton_cm", "sign"), True),
        ("tufting", ("zero",), False),
        ("loom", ("friction",), True),
        ("loom", ("half_turn",), False),
        *more(
            ("tufting", ("ratio",), True),
            ("loom", ("degrees",), False),
            ("loom", ("slow_angle",), True),
            ("tufting", ("other_machine",), True),
            ("loom", ("flywheel",), True),
            ("tufting", ("flywheel",), True),
        ),
    ],
)
def test_a_mistake_is_named_first(machine: str, names: tuple[str, ...], run_up: bool) -> None:
    case, right = mistaken(machine, names, 902, run_up=run_up, duration_s=15.0)
    found = judged(case)
    assert found.verdict, "nothing was named"
    assert found.verdict[0].cause in right


@pytest.mark.parametrize("run_up", [True, *more(False)])
def test_what_is_too_small_to_be_named_does_not_move_what_is(run_up: bool) -> None:
    """An offset of a hundredth of the torque's peak acts as 1.5 % of gain if it is not fitted."""
    case = healthy("tufting", 913, run_up=run_up, duration_s=18.0)
    judgement = judged(replace(case, torque=replace(case.torque, gain=1.09, offset_Nm=0.2)))
    (found,) = judgement.verdict
    assert found.cause == "torque_gain"
    # the file's masses and forces, within their tolerances, determine the scale to one per cent
    assert found.value == pytest.approx(1.09, abs=3.0 * found.sigma) and found.sigma < 0.02
    assert judgement.found is not None
    value, sigma = judgement.found.settled.given_file(GAIN)
    assert gain_factor(value) == pytest.approx(1.09, abs=max(3.0 * sigma, 0.001)) and sigma < 0.002


@pytest.mark.slow
def test_a_run_up_separates_zero_and_delay() -> None:
    case = healthy("tufting", 903, duration_s=14.0)
    case = replace(
        case,
        encoder=replace(case.encoder, zero_rad=math.radians(12.0)),
        torque=replace(case.torque, delay_s=0.006),
    )
    judgement = judged(case)
    found = {cause.cause: cause.value for cause in judgement.verdict}
    assert set(found) == {"encoder_zero", "delay"} and judgement.explained > 0.99
    assert found["encoder_zero"] == pytest.approx(math.radians(12.0), abs=math.radians(0.1))
    assert found["delay"] == pytest.approx(0.006, abs=2e-4)


def test_at_one_speed_zero_and_delay_are_one() -> None:
    case = healthy("tufting", 904, run_up=False, duration_s=12.0)
    first = judged(replace(case, encoder=replace(case.encoder, zero_rad=math.radians(12.0)))).verdict[0]
    assert first.cause == "zero_or_delay"
    assert isinstance(first.value, dict)
    assert math.degrees(first.value["zero_rad"]) == pytest.approx(12.0, abs=0.03)
    assert first.value["delay_s"] == pytest.approx(math.radians(12.0) / 16.755, rel=0.003)


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize(
    ("ratio", "causes"), [(1.0, ["angle_unit"]), *more((1.0 / 3.0, ["angle_unit", "encoder_ratio"]))]
)
def test_an_angle_in_degrees_that_is_not_wrapped_is_seen_by_its_torque(ratio: float, causes: list[str]) -> None:
    case = healthy("loom", 905, run_up=False, duration_s=6.0)
    case = replace(case, encoder=replace(case.encoder, turn=360.0, wrapped=False, ratio=ratio))
    assert [cause.cause for cause in judged(case).verdict[: len(causes)]] == causes


@pytest.mark.parametrize(("turns", "noted"), [(1.5, False), (4.0, True)])
def test_a_single_wrap_is_not_noted_as_another_unit(turns: float, noted: bool) -> None:
    stamps = 1_000_000_000 + 5_000_000 * np.arange(round(200 * turns))
    angle = np.mod(360.0 * np.arange(stamps.size) / 200.0 + 1.0, 360.0)
    found = assess(Readings(stamps, angle, stamps, np.zeros(stamps.size)), configured_machine(healthy("tufting", 905)))
    assert any("--angle-unit deg" in note for note in found.notes) == noted


@pytest.mark.campaign
@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "run_up"), [("loom", False), *more(("loom", True), ("tufting", False), ("tufting", True))]
)
def test_another_machine_is_not_taken_for_another_unit(machine: str, run_up: bool) -> None:
    """The angle is not wrapped, so other units are tried."""
    case, _ = mistaken(machine, ("other_machine",), 1, run_up=run_up, duration_s=6.0)
    case = replace(case, encoder=replace(case.encoder, wrapped=False))
    names = [cause.cause for cause in judged(case).verdict]
    assert names[0] == "other_machine" and "angle_unit" not in names


@pytest.mark.slow
@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("force_N", [1e-200, *more(0.0, 1e-100)])
def test_a_load_without_effect_is_left_as_it_is(force_N: float) -> None:
    case = healthy("tufting", 904, duration_s=6.0)
    made = record(replace(case, backing=replace(case.backing, force_N=0.0)))
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    found = assess(readings, create("tufting", backing_force_N=force_N))
    assert found.found is not None
    assert not any(cause.cause == "load_force" for cause in found.verdict)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [True, *more(False)])
def test_settings_that_explain_nothing_are_not_reported(noise: bool) -> None:
    case = healthy("tufting", 909, duration_s=5.0)
    case = replace(case, encoder=replace(case.encoder, ratio=5.0 / 3.0))
    made = record(case)
    torque = np.random.default_rng(3).standard_normal(made.torque.size) if noise else made.torque
    assessment = judged(case, replace(made, torque=torque))
    (found,) = assessment.verdict
    assert found.cause == "other_machine"
    assert assessment.found is not None
    p = assessment.found.posterior
    behind = replace(p, fit=replace(p.fit, hypothesis=replace(p.hypothesis, filters=frozenset({HIGH_PASS}))))
    assert without_law(p) == "" and "the force of backing depends on its measure" in without_law(behind)
    assert not noise or "a gear other than 1, 2, 3, 4" in found.text


@pytest.mark.parametrize(("offset", "causes"), [(140.0, ["torque_unit"]), (240.0, ["torque_unit", "torque_offset"])])
def test_a_configured_offset_is_no_fault_in_another_unit(offset: float, causes: list[str]) -> None:
    case = healthy("loom", 908, duration_s=15.0)
    torque, configured = replace(case.torque, gain=100.0, offset_Nm=offset), replace(case.configured, offset_Nm=1.4)
    assert [cause.cause for cause in judged(replace(case, torque=torque, configured=configured)).verdict] == causes


def _cut(made: MillRecording, chosen: np.ndarray) -> MillRecording:
    return replace(made, angle_stamps_ns=made.angle_stamps_ns[chosen], angle=made.angle[chosen])


def test_an_uninformative_recording_is_reported_in_words() -> None:
    case = healthy("tufting", 906, duration_s=14.0)
    made = record(case)
    rest = made.angle_stamps_ns < made.angle_stamps_ns[0] + 900_000_000
    found = judged(case, _cut(made, rest))
    assert found.found is None and "stands still" in found.notes[0]
    short = (made.angle_stamps_ns > made.angle_stamps_ns[0] + 6_000_000_000) & (
        made.angle_stamps_ns < made.angle_stamps_ns[0] + 6_200_000_000
    )
    found = judged(case, _cut(made, short))
    assert found.found is None and "of a turn" in found.notes[0]
    found = judged(case, replace(made, torque_stamps_ns=made.torque_stamps_ns + 3_600 * 10**9))
    assert found.found is None and "one clock" in found.notes[0]
    found = judged(case, replace(made, torque=np.full_like(made.torque, 0.25)))
    assert found.found is None and "dead sensor" in found.notes[0]
    rounding = 1e-13 * np.random.default_rng(1).standard_normal(made.torque.size)
    found = judged(case, replace(made, torque=1.4 + rounding))
    assert found.found is None and "1.4 throughout" in found.notes[0]
    with pytest.raises(RecordingError, match="6830 torque samples, none finite"):
        judged(case, replace(made, torque=np.full_like(made.torque, np.nan)))


def test_gaps_are_reported_and_do_no_harm() -> None:
    case = healthy("tufting", 907, duration_s=18.0)
    made = record(case)
    second = (made.angle_stamps_ns - made.angle_stamps_ns[0]) * 1e-9
    found = judged(case, _cut(made, ~((second > 7.0) & (second < 8.5))))
    assert found.verdict == ()
    assert len(found.notes) == 1


@pytest.mark.slow
def test_an_existing_track_gives_the_same_verdict() -> None:
    case = healthy("tufting", 903, run_up=False, duration_s=12.0)
    case = replace(
        case,
        encoder=replace(case.encoder, direction=-1, ratio=0.5, zero_rad=0.8),
        configured=replace(case.configured, direction=-1, ratio=0.5, zero_rad=0.8),
    )
    made, machine = record(case), configured_machine(case)
    angles = AngleSamples("main_shaft/angle", made.angle_stamps_ns, made.angle, None)
    track = recompute(angles, machine).track
    assert track is not None
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    again, with_it = assess(readings, machine), assess(readings, machine, track)
    assert with_it.explained == pytest.approx(again.explained, abs=1e-6)
    assert with_it.explained > 0.99
    assert with_it.verdict == again.verdict == ()


def _driver_set_right(made: MillRecording, before_s: float) -> MillRecording:
    """Record of a driver that logged degrees for a while, without torque, and was restarted two seconds before it."""
    stamps = made.angle_stamps_ns[0] - 2_000_000_000 - np.arange(int(before_s * 500.0))[::-1] * 2_000_000
    degrees = np.degrees(16.755) * (stamps - stamps[0]) * 1e-9
    return replace(
        made,
        angle_stamps_ns=np.concatenate([stamps, made.angle_stamps_ns]),
        angle=np.concatenate([degrees, made.angle]),
    )


@pytest.mark.campaign
def test_angles_without_torque_before_a_recording_give_no_false_cause() -> None:
    """The angles are in degrees, so the later angle in radians wraps each turn without being detected."""
    case = healthy("tufting", 908, run_up=False, duration_s=20.0)
    made, machine = _driver_set_right(record(case), 14.0), configured_machine(case)
    angles = AngleSamples("main_shaft/angle", made.angle_stamps_ns, made.angle, None)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    for track in (None, recompute(angles, machine).track):
        found = assess(readings, machine, track)
        assert [cause.text for cause in found.verdict] == []
        assert found.unit.name == "radians"
        assert found.explained > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(("second", "by_rad"), [(1.0, -2.0), *more((9.0, 0.3))])
def test_a_slip_of_the_encoder_is_reported_with_its_time_and_gives_no_false_cause(second: float, by_rad: float) -> None:
    case = healthy("tufting", 910, run_up=False, duration_s=14.0)
    made = record(case)
    after = made.angle_stamps_ns > made.angle_stamps_ns[0] + int(second * 1e9)
    angle = np.mod(made.angle + np.where(after, 0.0, -by_rad), 2.0 * math.pi)
    made = replace(made, angle=angle if second < 5.0 else np.mod(made.angle + by_rad * after, 2.0 * math.pi))
    found = judged(case, made)
    assert [cause.text for cause in found.verdict] == []
    note = next(note for note in found.notes if "leaps as no shaft does" in note)
    assert float(note.split(" deg at ")[1].split(" s")[0]) == pytest.approx(second, abs=0.02)
    assert float(note.split(": ")[1].split(" deg")[0]) == pytest.approx(math.degrees(by_rad), abs=1.0)
    readings = Readings(made.angle_stamps_ns, made.angle, made.torque_stamps_ns, made.torque)
    settled = calibrate(readings, configured_machine(case))
    assert (settled.direction, settled.sign) == (1, 1)
    assert settled.rms_after_Nm < 0.2
