"""textile-twin simulate: the format of the table, the published numbers, and mistakes."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest
from rosbags.highlevel import AnyReader

import textile_twin_core as ttc
from tests.campaign import more
from textile_twin_core.cli.main import main
from textile_twin_core.comparison import compare_torque
from textile_twin_core.recordings import open_bag
from textile_twin_core.recordings.prediction import recompute

MOTION = ["theta_rad", "omega_rad_s", "alpha_rad_s2"]


def _read(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    return rows[0], np.array([[float(cell) for cell in row] for row in rows[1:]])


def test_one_revolution_at_constant_speed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "f.csv"
    assert main(["simulate", "tufting", "--rpm", "160", "--samples", "360", "--out", str(out)]) == 0
    assert "360 samples" in capsys.readouterr().out
    names, rows = _read(out)
    assert names[:3] == MOTION
    np.testing.assert_array_equal(rows[:, 0], 2.0 * math.pi * np.arange(360) / 360)
    np.testing.assert_array_equal(rows[:, 1], 160.0 * 2.0 * math.pi / 60.0)
    np.testing.assert_array_equal(rows[:, 2], 0.0)
    parts = rows[:, [names.index(f"torque_{part}_Nm") for part in ("inertial", "gravity", "load")]]
    np.testing.assert_allclose(parts.sum(axis=1), rows[:, names.index("balancing_torque_Nm")], atol=1e-13)


def test_the_published_stroke_and_peak_torque(tmp_path: Path) -> None:
    """Xu et al. 2016: needle stroke 32.788 mm, largest torque 17.2786 N m at 160 rpm."""
    out = tmp_path / "f.csv"
    main(["simulate", "tufting", "--rpm", "160", "--samples", "36000", "--out", str(out)])
    names, rows = _read(out)
    stroke = np.ptp(rows[:, names.index("needle_position_m")])
    assert stroke == pytest.approx(32.788e-3, abs=5e-7)
    assert rows[:, names.index("balancing_torque_Nm")].max() == pytest.approx(17.2786, abs=1e-3)


def test_a_table_of_motion_keeps_its_columns_first(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    motion = {
        "time_s": np.arange(50) * 0.002, "theta_rad": rng.normal(size=50) * 100,
        "omega_rad_s": rng.normal(size=50) * 20, "alpha_rad_s2": rng.normal(size=50) * 1e3,
    }  # fmt: skip
    table = tmp_path / "motion.csv"
    with table.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "note", *MOTION])
        for k in range(50):
            writer.writerow([motion["time_s"][k], "text", *(repr(float(motion[name][k])) for name in MOTION)])
    asked = "needle_velocity_m_s,balancing_torque_Nm"
    for suffix in ("csv", "parquet"):
        out = tmp_path / f"out.{suffix}"
        assert main(["simulate", "tufting", "--input", str(table), "--outputs", asked, "--out", str(out)]) == 0
    names, rows = _read(tmp_path / "out.csv")
    assert names == [*MOTION, "time_s", "needle_velocity_m_s", "balancing_torque_Nm"]
    for k, name in enumerate(names[:4]):
        np.testing.assert_array_equal(rows[:, k], motion[name])
    twin = ttc.compile(ttc.machines.tufting(), asked.split(","))
    expected = twin.evaluate(*(motion[name] for name in MOTION))
    for k, name in enumerate(asked.split(",")):
        np.testing.assert_allclose(rows[:, 4 + k], expected[name], rtol=1e-9)
    stored = pyarrow.parquet.read_table(tmp_path / "out.parquet")
    assert stored.column_names == names
    np.testing.assert_array_equal(np.stack([stored[name].to_numpy() for name in names], axis=1), rows)


def test_a_table_written_is_a_table_of_motion(tmp_path: Path) -> None:
    first, second = tmp_path / "a.csv", tmp_path / "b.csv"
    main(["simulate", "tufting", "--rpm", "-300", "--samples", "77", "--out", str(first)])
    main(["simulate", "tufting", "--input", str(first), "--out", str(second)])
    assert first.read_bytes() == second.read_bytes()


def test_a_recording_of_the_simulation(tmp_path: Path) -> None:
    out = tmp_path / "f.mcap"
    asked = "balancing_torque_Nm,needle_position_m"
    assert main(
        ["simulate", "tufting", "--rpm", "60", "--samples", "100", "--outputs", asked, "--out", str(out)]
    ) == 0  # fmt: skip
    with AnyReader([out]) as reader:
        assert {c.topic: c.msgcount for c in reader.connections} == {
            "/main_shaft/angle": 100, "/balancing_torque/predicted": 100, "/balancing_torque/measured": 100,
            "/outputs/balancing_torque_Nm": 100, "/outputs/needle_position_m": 100,
        }  # fmt: skip
    angles = open_bag(out).read_angles()
    np.testing.assert_array_equal(np.diff(angles.stamps), 10_000_000)
    np.testing.assert_array_equal(angles.angles_rad, 2 * math.pi * np.arange(100) / 100)


@pytest.mark.parametrize("configured", [True, *more(False)])
def test_a_recording_of_the_simulation_follows_the_sensor_models(configured: bool, tmp_path: Path) -> None:
    """Check that the machine file explains its own simulation, and that a file without sensors gives a verdict
    on each.
    """
    machine, out = tmp_path / "mine.yaml", tmp_path / "f.mcap"
    machine.write_text(
        "machine: tufting\nname: mine\nsensors: {encoder: {zero_rad: 0.4, direction: -1, ratio: 0.5},"
        " torque: {gain: 1.2, offset_Nm: 3, delay_s: 0.004}}\n"
    )
    time = np.arange(3000) / 500.0
    speed = 10.0 + 2.0 * np.minimum(time, 3.0)
    theta = 0.3 + np.where(time < 3.0, 10.0 * time + time**2, 39.0 + 16.0 * (time - 3.0))
    motion = np.stack([theta, speed, np.where(time < 3.0, 2.0, 0.0), time], axis=1)
    np.savetxt(
        tmp_path / "m.csv", motion, delimiter=",", header="theta_rad,omega_rad_s,alpha_rad_s2,time_s", comments=""
    )
    assert main(["simulate", str(machine), "--input", str(tmp_path / "m.csv"), "--out", str(out)]) == 0
    bag = open_bag(out)
    angles, shown = bag.read_angles(), bag.read_torques("balancing_torque/measured")
    true = bag.read_torques("balancing_torque/predicted")
    np.testing.assert_allclose(angles.angles_rad, -2.0 * theta + 0.4, atol=1e-12)
    np.testing.assert_allclose(angles.velocities, -2.0 * speed, atol=1e-12)
    np.testing.assert_array_equal(shown.stamps - true.stamps, 4_000_000)
    np.testing.assert_allclose(shown.torque_Nm, 1.2 * true.torque_Nm + 3.0, atol=1e-12)
    declared = str(machine) if configured else "tufting"
    assert main(["compare", str(out), "--machine", declared, "--json", str(tmp_path / "c.json")]) == 0
    causes = {cause["cause"] for cause in json.loads((tmp_path / "c.json").read_text())["verdict"]}
    expected = {"encoder_direction", "encoder_ratio", "torque_gain", "zero_or_delay"}
    assert not causes if configured else causes >= expected, causes


@pytest.mark.parametrize(("delay_s", "first_ns"), [(-5.0, 6_000_000_000), (5.0, 1_000_000_000)])
def test_a_recording_begins_after_zero_however_early_the_torque_is(
    delay_s: float, first_ns: int, tmp_path: Path
) -> None:
    machine, out = tmp_path / "mine.yaml", tmp_path / "f.mcap"
    machine.write_text(f"machine: tufting\nname: mine\nsensors: {{torque: {{delay_s: {delay_s}}}}}\n")
    assert main(["simulate", str(machine), "--rpm", "60", "--samples", "100", "--out", str(out)]) == 0
    angles, torques = open_bag(out).read_angles(), open_bag(out).read_torques("balancing_torque/measured")
    assert angles.stamps[0] == first_ns
    np.testing.assert_array_equal(torques.stamps - angles.stamps, round(delay_s * 1e9))
    assert torques.stamps[0] >= 1_000_000_000


def test_a_recording_with_a_toothed_wheel_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine, out = tmp_path / "mine.yaml", tmp_path / "f.mcap"
    machine.write_text("machine: tufting\nname: mine\nsensors: {encoder: {teeth: 60, missing_teeth: 2}}\n")
    words = ["simulate", str(machine), "--rpm", "60", "--samples", "100", "--out"]
    assert main([*words, str(out)]) == 2
    told = capsys.readouterr().err
    assert "60 teeth" in told and told.count("\n") == 1 and not out.exists()
    assert main([*words, str(tmp_path / "f.csv")]) == 0


def test_a_machine_of_the_users_own(tmp_path: Path) -> None:
    machine = tmp_path / "fourbar.yaml"
    machine.write_text(
        """
        points: {O: [0, 0], C: [0.3, 0]}
        groups:
          - {type: crank, name: crank, at: O, end: A, length_m: 0.06}
          - {type: rrr_dyad, coupler: l2, rocker: l3, from: A, ground: C, end: B, lengths_m: [0.2, 0.23]}
        bodies: {l2: {mass_kg: 0.4, inertia_kgm2: 0.0015}}
        scene: {outputs: [balancing_torque_Nm, point_B_x_m, point_B_y_m]}
        """
    )
    out = tmp_path / "f.csv"
    assert main(["simulate", str(machine), "--rpm", "90", "--samples", "90", "--out", str(out)]) == 0
    names, rows = _read(out)
    assert names == [*MOTION, "balancing_torque_Nm", "point_B_x_m", "point_B_y_m"]
    ax, ay = 0.06 * np.cos(rows[:, 0]), 0.06 * np.sin(rows[:, 0])
    np.testing.assert_allclose(np.hypot(rows[:, 4] - ax, rows[:, 5] - ay), 0.2, rtol=1e-12)
    np.testing.assert_allclose(np.hypot(rows[:, 4] - 0.3, rows[:, 5]), 0.23, rtol=1e-12)


def test_a_machine_with_impacts_reports_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Pejchar and Beran 2011: the original reaches the pad at 15.75 ms, elements 2 and 3 meet at 19.23 ms; the
    optimised design reaches it at 17.96 ms.
    """
    out = tmp_path / "f.csv"
    turn = ["--rpm", "250", "--samples", "100", "--out", str(out)]
    assert main(["simulate", "needle_transfer", *turn]) == 0
    text = capsys.readouterr().out
    times = {line.split(" ms ")[1].strip(): float(line.split()[0]) for line in reversed(text.splitlines()[1:])}
    assert times["rubber_pad touch"] == pytest.approx(15.75, abs=0.05)
    assert next(time for what, time in times.items() if "collet_contact" in what) == pytest.approx(19.3, abs=0.2)
    names, rows = _read(out)
    assert names[3:6] == ["element_1_position_m", "element_1_velocity_m_s", "element_1_acceleration_m_s2"]
    assert rows[:, 3].max() == pytest.approx(0.0326, rel=1e-12)
    assert main(["simulate", "needle_transfer", "--set", "design=optimised", *turn]) == 0
    assert "17.9544" in capsys.readouterr().out


def test_a_picture_and_a_table_of_one_turn_at_the_usual_samples(tmp_path: Path) -> None:
    out, png = tmp_path / "turn.csv", tmp_path / "turn.png"
    assert main(["simulate", "tufting", "--rpm", "160", "--out", str(out), "--png", str(png)]) == 0
    assert len(out.read_text().splitlines()) == 361 and png.read_bytes().startswith(b"\x89PNG")


def test_nothing_is_drawn_before_all_arguments_are_checked(tmp_path: Path) -> None:
    png = tmp_path / "turn.png"
    assert main(["simulate", "tufting", "--out", str(tmp_path / "turn.csv"), "--png", str(png)]) == 2
    assert not png.exists()


_TURN = ["--rpm", "160", "--samples", "36"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["tuftin", *_TURN], "did you mean tufting"),
        (["no_such.yaml", *_TURN], "no_such.yaml: no such file"),
        (["tufting", *_TURN, "--outputs", "balancing_torqe_Nm"], "did you mean balancing_torque_Nm"),
        (["tufting", *_TURN, "--outputs", ","], "--outputs names nothing"),
        (["tufting", "--samples", "90"], "--rpm R"),
        (["tufting"], "--input motion.csv"),
        (["tufting", "--rpm", "fast", "--samples", "3"], "must be a number, not 'fast'"),
        (["tufting", "--rpm", "nan", "--samples", "3"], "must be a number, not 'nan'"),
        (["tufting", "--rpm", "1", "--samples", "0"], "whole number from 1 on"),
        (["tufting", *_TURN, "--method", "magic"], "invalid choice: 'magic'"),
        (["tufting", *_TURN, "--set", "l1=3"], "did you mean"),
        (["tufting", *_TURN, "--set", "l1_m"], "--set l1_m"),
        (["tufting", *_TURN, "--set", "l1_m=long"], "--set l1_m: must be a number, not 'long'"),
        (["needle_transfer", *_TURN, "--set", "design=foo"], "original and optimised"),
        (["needle_transfer", *_TURN, "--method", "table"], "no table"),
        (["tufting", *_TURN, "--set", "l1_m=0.1"], "cannot"),
        (["tufting", *_TURN, "--set", "m1_kg=-1"], "m"),
        (["tufting", *_TURN, "--input", "motion.csv"], "--input stands alone"),
        (["tufting", "--input", "missing.csv"], "missing.csv: no such file"),
        (["tufting", "--rpm", "1e9", "--samples", "4"], "must be a speed in rpm, at most 100000, not '1e9'"),
    ],
)
def test_a_mistake_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    assert main(["simulate", *arguments, "--out", str(tmp_path / "f.csv")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("textile-twin: ")
    assert says in captured.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("theta_rad,omega_rad_s\n1,2\n", "column alpha_rad_s2 is missing; available: theta_rad, omega_rad_s"),
        ("", "column theta_rad, omega_rad_s, alpha_rad_s2 is missing; available: none"),
        ("theta_rad,omega_rad_s,alpha_rad_s2\n", "no rows"),
        ("theta_rad,omega_rad_s,alpha_rad_s2\n0,1,2\n0,nan,2\n", "line 3: omega_rad_s is 'nan'"),
        ("theta_rad,omega_rad_s,alpha_rad_s2\n0,1,2\n\n0,,2\n", "line 4: omega_rad_s is ''"),
        ("theta_rad,omega_rad_s,alpha_rad_s2\n0,1,2\nfast,1,2\n", "line 3: theta_rad is 'fast'"),
        ("theta_rad,omega_rad_s,alpha_rad_s2\n0,1,inf\n", "line 2: alpha_rad_s2 is 'inf'"),
        ("theta_rad,omega_rad_s,alpha_rad_s2\n0,1,2\n0,1\n", "line 3: alpha_rad_s2 is ''"),
        ("time_s,theta_rad,omega_rad_s,alpha_rad_s2\n0,0,1,2\n0,0,1,2\n", "row 2: time_s does not increase"),
    ],
)
def test_a_bad_table_is_named_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, says: str
) -> None:
    table = tmp_path / "motion.csv"
    table.write_text(text)
    assert main(["simulate", "tufting", "--input", str(table), "--out", str(tmp_path / "f.csv")]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert [entry.name for entry in tmp_path.iterdir()] == ["motion.csv"]


@pytest.mark.parametrize("place", ["missing/deeper/f.csv", "file/f.csv", "file/deeper/f.csv", "folder", "f.txt"])
def test_a_place_that_cannot_be_written(tmp_path: Path, capsys: pytest.CaptureFixture[str], place: str) -> None:
    (tmp_path / "file").write_text("no folder")
    (tmp_path / "folder").mkdir()
    assert main(["simulate", "tufting", *_TURN, "--out", str(tmp_path / place)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["file", "folder"]


def test_a_missing_folder_is_made(tmp_path: Path) -> None:
    assert main(["simulate", "tufting", *_TURN, "--out", str(tmp_path / "out" / "f.csv")]) == 0
    assert (tmp_path / "out" / "f.csv").stat().st_size > 0


@pytest.mark.parametrize(
    ("theta", "asks"),
    [
        (np.arange(0.0, 360.0), True),
        (np.arange(-180.0, 180.0, 5.0), True),
        (np.arange(720) % 360.0, True),
        (np.arange(0.0, 350.0, 0.05), False),  # fifty-six turns if read as radians
        (np.linspace(0.0, 2.0 * np.pi, 12), False),
        (np.arange(0.0, 900.0, 1.0), False),
    ],
)
def test_degrees_in_a_column_of_radians_are_asked_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], theta: np.ndarray, asks: bool
) -> None:
    table = tmp_path / "motion.csv"
    rows = "".join(f"{value},1,0\n" for value in theta)
    table.write_text(f"theta_rad,omega_rad_s,alpha_rad_s2\n{rows}")
    assert main(["simulate", "tufting", "--input", str(table), "--out", str(tmp_path / "f.csv")]) == 0
    assert ("are these degrees?" in capsys.readouterr().err) is asks


def test_a_recording_without_times_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "motion.csv"
    table.write_text("theta_rad,omega_rad_s,alpha_rad_s2\n0,1,0\n1,2,0\n")
    assert main(["simulate", "tufting", "--input", str(table), "--out", str(tmp_path / "f.mcap")]) == 2
    assert "time_s" in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.iterdir()] == ["motion.csv"]


def _command(*arguments: str) -> subprocess.CompletedProcess[str]:
    code = "import sys; from textile_twin_core.cli.main import main; sys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=False, timeout=120
    )


def test_the_command_as_a_process(tmp_path: Path) -> None:
    good = _command("simulate", "tufting", *_TURN, "--out", str(tmp_path / "f.csv"))
    assert (good.returncode, good.stderr) == (0, "")
    bad = _command("simulate", "loom_of_dreams", *_TURN, "--out", str(tmp_path / "g.csv"))
    assert (bad.returncode, bad.stdout, bad.stderr.count("\n")) == (2, "", 1)
    unknown = _command("simulat")
    assert (unknown.returncode, "did you mean simulate?" in unknown.stderr) == (2, True)
    assert _command("--help").returncode == 0


def test_help_needs_no_engine() -> None:
    """Check the imports of --help, which determine its start-up time."""
    code = (
        "import sys; from textile_twin_core.cli.main import main; code = main(['--help']);"
        "sys.exit(code or any(name in sys.modules for name in ('numpy', 'scipy', 'yaml', 'mcap')))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, check=False).returncode == 0


def test_an_internal_error_is_one_line_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from textile_twin_core.cli import simulate

    monkeypatch.setattr(simulate, "load_machine", lambda *_: 1 / 0)
    assert main(["simulate", "tufting", *_TURN, "--out", str(tmp_path / "f.csv")]) == 1
    error = capsys.readouterr().err
    assert "a fault of textile-twin" in error
    assert error.count("\n") == 1


def test_trouble_with_the_disk_is_not_ours(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import pyarrow.csv

    def no_room(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pyarrow.csv, "write_csv", no_room)
    assert main(["simulate", "tufting", *_TURN, "--out", str(tmp_path / "f.csv")]) == 2
    assert "no space left on device" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_machines_lists_outputs_and_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["machines"]) == 0
    text = capsys.readouterr().out
    for name in ttc.machines.NAMES:
        assert f"{name}: " in text
    for word in ("balancing_torque_Nm", "needle_position_m", "reaction_guide_N", "l1_m=0.015", "m1_kg=3.07"):
        assert word in text


@pytest.mark.parametrize("name", ["motion.csv", "link.csv"])
def test_the_table_that_is_read_is_not_written_over(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = tmp_path / "motion.csv"
    motion.write_text("theta_rad,omega_rad_s,alpha_rad_s2\n0,1,0\n0.1,1,0\n")
    (tmp_path / "link.csv").symlink_to(motion)
    before = motion.read_text()
    out = str(tmp_path / name)
    assert main(["simulate", "tufting", "--input", str(motion), "--out", out]) == 2
    said = capsys.readouterr().err
    assert out in said and said.count("\n") == 1
    assert motion.read_text() == before


@pytest.mark.parametrize(
    ("theta", "omega", "time"),
    [(1.0, 1.0, 1.0), (180.0 / np.pi, 1.0, 1.0), (1.0, 30.0 / np.pi, 1.0), (1.0, 1.0, 1000.0)],
)
@pytest.mark.parametrize("wrapped", [True, False])
def test_angles_and_speeds_that_disagree_over_the_times_are_reported(
    theta: float,
    omega: float,
    time: float,
    wrapped: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    at = np.arange(800) / 500.0
    turned = 12.5 * at + 0.02 * np.sin(12.5 * at)
    turned = np.round(np.mod(turned, 2.0 * np.pi) if wrapped else turned, 2)  # as from an encoder with few counts
    speeds = 12.5 * (1.0 + 0.02 * np.cos(12.5 * at))
    rows = np.c_[theta * turned, omega * speeds, 0.0 * at, time * at]
    table = tmp_path / "motion.csv"
    np.savetxt(table, rows, delimiter=",", header="theta_rad,omega_rad_s,alpha_rad_s2,time_s", comments="")
    assert main(["simulate", "tufting", "--input", str(table), "--out", str(tmp_path / "out.csv")]) == 0
    said = capsys.readouterr().err
    asked = "are these degrees?" in said or "is one in degrees, rpm or ms? They are taken as named" in said
    assert asked == ((theta, omega, time) != (1.0, 1.0, 1.0)), said


@pytest.mark.filterwarnings("error")
def test_characters_that_the_font_of_pictures_lacks_are_named_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = tmp_path / "machine.yaml"
    machine.write_text("machine: tufting\nname: 簇绒机\n", encoding="utf-8")
    outs = ["--out", str(tmp_path / "s.csv"), "--png", str(tmp_path / "s.png")]
    assert main(["simulate", str(machine), "--rpm", "160", "--samples", "36", *outs]) == 0
    assert capsys.readouterr().err == "textile-twin: the font of pictures has no 簇 绒 机: drawn as boxes\n"
    assert (tmp_path / "s.png").stat().st_size > 20_000


def test_a_simulated_recording_has_the_measuring_chain_of_the_file(tmp_path: Path) -> None:
    """The run-out and the high pass in closed form; compared with the same file, nothing is left."""
    (tmp_path / "mill.yaml").write_text(
        "machine: tufting\n"
        "sensors: {encoder: {zero_rad: 0.2, eccentricity_rad: [[0.01, -0.02]]},"
        " torque: {gain: 1.1, low_pass_s: 0.01, high_pass_hz: 0.5}}\n"
    )
    time, speed = np.arange(2500) * 0.002, 16.755
    rows = (f"{t!r},{speed * t!r},{speed},0.0" for t in time.tolist())
    (tmp_path / "motion.csv").write_text("\n".join(["time_s,theta_rad,omega_rad_s,alpha_rad_s2", *rows]))
    bag, file = tmp_path / "bag.mcap", str(tmp_path / "mill.yaml")
    assert main(["simulate", file, "--input", str(tmp_path / "motion.csv"), "--out", str(bag)]) == 0
    seen, q = open_bag(bag).read_angles(), speed * time + 0.2
    np.testing.assert_allclose(seen.angles_rad, q + 0.01 * np.cos(q) - 0.02 * np.sin(q), atol=1e-12)
    np.testing.assert_allclose(seen.velocities, speed * (1.0 - 0.01 * np.sin(q) - 0.02 * np.cos(q)), rtol=1e-12)
    torque = open_bag(bag).read_torques().torque_Nm
    assert abs(torque[1250:].mean()) < 0.02 * np.abs(torque).max()
    machine = ttc.load_machine(file)
    assert isinstance(machine, ttc.Machine)
    known, measured = recompute(seen, machine), open_bag(bag).read_torques()
    compared = compare_torque(
        measured.stamps, measured.torque_Nm, known.stamps_ns, known.torque_Nm, known.theta_rad,
        torque_sensor=machine.sensors.torque, events=machine.events(), settled=known.settled,
    )  # fmt: skip
    assert compared.errors.rms_over_peak < 2e-3
