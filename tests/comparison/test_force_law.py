"""Force laws learned from torque, in recordings whose truth is computed without the engine."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import textile_twin_core as ttc
from tests.campaign import more
from tests.generators.configured_machine import configured_machine
from tests.generators.force_laws import LAWS, MillRecording, case_of, force, record_law
from tests.generators.mill_recordings import Case
from tests.generators.shaft_law import Friction
from textile_twin_core.cli import compare as compare_command
from textile_twin_core.cli.main import main
from textile_twin_core.comparison import Readings
from textile_twin_core.comparison.assessment import Assessment, assess
from textile_twin_core.comparison.curve_identification import CurveIdentification, identify_curve
from textile_twin_core.dynamics.loads import ForceCurve
from textile_twin_core.inference.parameter import COULOMB, DELAY, GAIN, VISCOUS, ZERO, gain_factor
from textile_twin_core.machine import Machine
from textile_twin_core.recordings import BagWriter

DELAY_S, FRICTION = 0.0026, Friction(0.01, 0.25)
DURATION_S = 24.0


@dataclass(frozen=True)
class Made:
    """A recording, its truth and its machine file."""

    case: Case
    recording: MillRecording
    machine: Machine

    @property
    def readings(self) -> Readings:
        r = self.recording
        return Readings(r.angle_stamps_ns, r.angle, r.torque_stamps_ns, r.torque)


@cache
def made(name: str, seed: int = 1, duration_s: float = DURATION_S) -> Made:
    law = LAWS[name]
    case = case_of(law, seed, duration_s=duration_s)
    case = replace(case, torque=replace(case.torque, delay_s=DELAY_S))
    if law.machine == "tufting":
        case = replace(case, friction=FRICTION)
    return Made(case, record_law(law, case), configured_machine(case))


def bag_of(here: Made, path: Path) -> str:
    r = here.recording
    with BagWriter(path) as out:
        out.write_joint_states("main_shaft/angle", r.angle_stamps_ns, ["main_shaft"], r.angle)
        out.write_wrenches("balancing_torque/measured", r.torque_stamps_ns, r.torque)
    return str(path)


@cache
def judged(name: str, seed: int = 1) -> Assessment:
    here = made(name, seed)
    return assess(here.readings, here.machine)


def assert_curve(name: str, curve: object, least: float = 0.95) -> float:
    """Assert that the law is the true one at most knots; return the share of knots within the 95 % band."""
    shares = []
    peak = np.abs(force(LAWS[name], curve.knots, True)).max()  # type: ignore[attr-defined]
    ways = ((True, "in"), (False, "out"))
    for growing, way in ways:
        found, sigma = getattr(curve, f"{way}_N"), getattr(curve, f"{way}_sigma_N")
        off = np.abs(found - force(LAWS[name], curve.knots, growing))  # type: ignore[attr-defined]
        assert np.mean((off < 0.02 * peak) | (off < 3.0 * sigma)) >= least, (name, way, off, sigma)
        shares.append(np.mean(off < 1.96 * sigma))
    return float(np.mean(shares))


@pytest.mark.parametrize(("name", "seed"), more(*((name, seed) for name in LAWS for seed in (2, 3))))
def test_laws_are_named_with_their_curve_and_nothing_else_is_accused(name: str, seed: int) -> None:
    found = judged(name, seed)
    causes = {cause.cause for cause in found.verdict}
    assert ("force_law" in causes) == (name != "constant")
    assert causes <= {"force_law", "load_force", "delay", "unmodelled_friction"}
    if found.law is not None:
        assert_curve(name, found.law.curve)


@dataclass(frozen=True)
class Compared:
    """What the command compare judged, and what it wrote."""

    judged: Assessment
    numbers: dict[str, Any]
    report: str


@pytest.fixture(scope="module")
def pierced(tmp_path_factory: pytest.TempPathFactory) -> Compared:
    """Compare a recording by the command: the search for a law is made once for all tests of a pierce."""
    folder, found = tmp_path_factory.mktemp("pierce"), list[Assessment]()

    def seen(*given: Any) -> Assessment:
        found.append(assess(*given))
        return found[-1]

    bag = bag_of(made("pierce"), folder / "bag")
    files = ["--html", str(folder / "r.html"), "--json", str(folder / "c.json")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compare_command, "assess", seen)
        assert main(["compare", bag, "--machine", "tufting", *files]) == 0
    return Compared(found[0], json.loads((folder / "c.json").read_text()), (folder / "r.html").read_text())


@pytest.mark.slow
def test_compare_writes_the_law_into_numbers_and_report(pierced: Compared) -> None:
    assert pierced.numbers["verdict"][0]["cause"] == "force_law"
    assert set(pierced.numbers["curves"]) == {"backing"}
    assert "Force of backing" in pierced.report


@pytest.mark.slow
def test_a_pierce_is_named_with_its_curve_and_no_sensor_is_accused(pierced: Compared) -> None:
    found = pierced.judged
    assert found.verdict[0].cause == "force_law" and found.verdict[0].parameter == "loads.backing"
    assert {cause.cause for cause in found.verdict[1:]} <= {"delay", "unmodelled_friction"}  # the file has neither
    assert found.law is not None and found.explained > 0.999
    assert assert_curve("pierce", found.law.curve) > 0.8
    peak = found.law.curve.knots[np.argmax(found.law.curve.in_N)]
    begin, end = found.law.curve.knots[[0, -1]]
    assert (peak - begin) / (end - begin) == pytest.approx(0.2, abs=0.03)
    p = found.found.posterior if found.found is not None else None
    assert p is not None
    assert p.value(DELAY) == pytest.approx(DELAY_S, abs=max(3.0 * p.sigma(DELAY), 5e-5))
    assert p.value(ZERO) == pytest.approx(0.0, abs=3.0 * p.sigma(ZERO))
    assert gain_factor(p.value(GAIN)) == pytest.approx(1.0, abs=3.0 * p.sigma(GAIN))
    friction = p.value(COULOMB) + SPEED * p.value(VISCOUS)
    assert friction == pytest.approx(FRICTION.coulomb_Nm + SPEED * FRICTION.viscous_Nms, abs=3.0 * p.sigma(COULOMB))


SPEED = 16.755


@pytest.mark.slow
def test_a_constant_force_is_no_law() -> None:
    found = judged("constant")
    assert found.law is None
    assert {cause.cause for cause in found.verdict} == {"delay", "load_force", "unmodelled_friction"}


STEP_NM = 0.5
CHAINS: dict[str, tuple[dict[str, float], tuple[tuple[float, float], ...], set[str]]] = {
    "low pass": ({"low_pass_hz": 38.8, "low_pass_order": 1}, (), {"torque_low_pass"}),
    "blocked mean": ({"high_pass_hz": 0.6}, (), {"torque_high_pass"}),
    "run-out": ({}, ((0.008, 0.006),), {"encoder_eccentricity"}),
    "run-out twice a turn": ({}, ((0.0, 0.0), (0.005, 0.004)), {"encoder_eccentricity"}),
    "steps": ({}, (), set()),
}
"""Settings of the torque sensor, run-out of the encoder [rad], and the causes that are right to name."""


@pytest.mark.slow
@pytest.mark.parametrize("chain", more(*CHAINS))
def test_a_law_is_learned_beside_a_measuring_chain(chain: str) -> None:
    law, (sensor, run_out, right) = LAWS["pierce"], CHAINS[chain]
    case = replace(case_of(law, 21, duration_s=DURATION_S), friction=FRICTION)
    case = replace(case, torque=replace(case.torque, delay_s=DELAY_S, **sensor))  # type: ignore[arg-type]
    case = replace(case, encoder=replace(case.encoder, run_out_rad=run_out))
    recording = record_law(law, case)
    if chain == "steps":
        recording = replace(recording, torque=STEP_NM * np.rint(recording.torque / STEP_NM))
    found = assess(Made(case, recording, configured_machine(case)).readings, configured_machine(case))
    named = {cause.cause: cause for cause in found.verdict}
    # a blocked mean leaves no friction to see
    assert right <= set(named) <= {"force_law", "delay", "unmodelled_friction", *right} and found.law is not None
    assert_curve("pierce", found.law.curve)
    assert named["delay"].value == pytest.approx(DELAY_S, abs=3.0 * named["delay"].sigma)
    if chain == "low pass":
        low_pass = named["torque_low_pass"]
        assert low_pass.value == pytest.approx(1.0 / (2.0 * np.pi * 38.8), abs=3.0 * low_pass.sigma)


@pytest.fixture(scope="module")
def beaten_up() -> CurveIdentification:
    here = made("beat-up")
    return identify_curve(here.readings, here.machine, "sley_position_m")


@pytest.mark.slow
def test_a_beat_up_resistance_is_learned_where_no_load_is_declared(beaten_up: CurveIdentification) -> None:
    curve = beaten_up.curves["sley_position_m"]
    assert_curve("beat-up", curve)
    assert curve.out_N.min() < -400.0  # the cloth springs back
    gain, delay = (beaten_up.parameters[f"torque_sensor_{what}"] for what in ("gain", "delay_s"))
    assert gain.value == pytest.approx(1.0, abs=3.0 * gain.sigma)
    assert delay.value == pytest.approx(DELAY_S, abs=max(3.0 * delay.sigma, 5e-5))
    assert beaten_up.rms_after_Nm == pytest.approx(0.08, abs=0.004)  # the sensor's noise


@pytest.mark.slow
def test_the_identified_machine_has_the_law_and_predicts_with_it(beaten_up: CurveIdentification) -> None:
    (law,) = (load for load in beaten_up.machine.loads if isinstance(load, ForceCurve))
    assert law.measure == "sley_position_m"
    after = assess(made("beat-up").readings, beaten_up.machine)
    assert after.verdict == () and after.law is None


@pytest.mark.slow
def test_identify_writes_the_law_into_numbers_and_machine_file(tmp_path: Path) -> None:
    bag = bag_of(made("grip", duration_s=12.0), tmp_path / "bag")
    files = ["--json", str(tmp_path / "i.json"), "--out", str(tmp_path / "grip.yaml")]
    assert main(["identify", bag, "--machine", "tufting", "--curve", "loads.backing", *files]) == 0
    curve = json.loads((tmp_path / "i.json").read_text())["curves"]["backing"]
    assert len(curve["knots"]) == len(curve["in_N"]) == len(curve["out_sigma_N"])
    assert np.median(curve["in_N"]) == pytest.approx(926.0, rel=0.03)
    assert np.median(curve["out_N"]) == pytest.approx(231.6, rel=0.03)
    assert curve["work_in_J"] > 3.0 * curve["work_out_J"] > 0.0
    machine = ttc.load_machine(tmp_path / "grip.yaml")
    assert isinstance(machine, Machine) and any(isinstance(load, ForceCurve) for load in machine.loads)
    given_law = ["--machine", str(tmp_path / "grip.yaml"), "--json", str(tmp_path / "again.json")]
    assert main(["identify", bag, *given_law]) == 0
    again = json.loads((tmp_path / "again.json").read_text())
    assert again["rms_before_Nm"] < 0.1  # samples beside the steps of the law aside
    delay = again["parameters"]["torque_sensor_delay_s"]
    assert delay["value"] == pytest.approx(DELAY_S, abs=3.0 * delay["sigma"])


def test_a_name_that_is_no_load_says_which_are_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "nowhere", "--machine", "tufting", "--curve", "needles"]) == 2
    assert "no load or measure 'needles'" in capsys.readouterr().err
