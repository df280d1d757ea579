"""textile-twin replay, compare and recover on small recordings, and one line for every bad recording."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

import textile_twin_core as ttc
from tests.full_disk import full_disk
from textile_twin_core.cli.main import main
from textile_twin_core.recordings import BagWriter, OfferedQos, open_bag
from textile_twin_core.recordings.schemas import MessageSchema

EPOCH = 1_700_000_000_000_000_000
RATE = 500
SECONDS = 3
OMEGA = 160 * 2 * np.pi / 60
DELAY = 0.002
NOISE = 0.02
PEAK = 17.2786
AIR_HASH = "RIHS01_d3a9d7dea9cf966a0b6cc58d044a3ed787c0a8c2d2644c45c35f998bf4e02299"


def _write(
    path: Path, change: dict[str, Any] | None = None, prefix: str = "", live: bool = False, angle: bool = True
) -> Path:
    """Write a steady shaft, its wrapped angle, and the torque of the machine at the true angle, delayed and noisy."""
    n = RATE * SECONDS
    time = np.arange(n) / RATE
    stamps = EPOCH + np.rint(time * 1e9).astype(np.int64)
    theta = OMEGA * time
    angles = np.mod(theta, 2 * np.pi)
    for k, value in (change or {}).items():
        angles[int(k)] = value
    twin = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm"])
    torque = twin.evaluate(theta - OMEGA * DELAY, OMEGA, 0.0)["balancing_torque_Nm"]
    noise = np.random.default_rng(2).normal(scale=NOISE, size=n)
    with BagWriter(path, {"made": "for a test"}, live=live) as out:
        if angle:
            out.write_joint_states(f"{prefix}/main_shaft/angle", stamps, ["main_shaft"], angles)
        out.write_wrenches(f"{prefix}/balancing_torque/measured", stamps + 300_000, torque + noise)
        qos = OfferedQos("best_effort", "volatile", 3)
        out.add_topic("/mill/humidity", "mill_msgs/msg/Air", qos, MessageSchema("float64 water\n", AIR_HASH))
        out.write("/mill/humidity", EPOCH, b"\x00\x01\x00\x00" + np.float64(0.5).tobytes())
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _write(tmp_path_factory.mktemp("bag") / "steady")


@pytest.fixture(scope="module")
def replayed(bag: Path) -> Path:
    out = bag.parent / "replayed"
    assert main(["replay", str(bag), "--machine", "tufting", "--out", str(out)]) == 0
    return out


def test_replay_predicts_each_sample_with_its_stamp(bag: Path, replayed: Path) -> None:
    angles, out = open_bag(bag).read_angles(), open_bag(replayed)
    predicted = out.read_torques("balancing_torque/predicted")
    np.testing.assert_array_equal(predicted.stamps, angles.stamps[2:])
    # The same twin and estimator, sample by sample as in a node.
    session = ttc.compile(ttc.machines.tufting(), ["balancing_torque_Nm", "point_F_y_m"]).session(shaft="causal")
    torque, needle = [], []
    for stamp, angle in zip(angles.stamps[:400], angles.angles_rad[:400], strict=True):
        samples = session.step(np.array([stamp]), np.array([angle]))
        torque += samples["balancing_torque_Nm"].tolist()
        needle += samples["point_F_y_m"].tolist()
    np.testing.assert_allclose(predicted.torque_Nm[: len(torque)], torque, atol=1e-9 * PEAK)
    points = out.read_points("needle/position")
    np.testing.assert_array_equal(points.stamps, predicted.stamps)
    np.testing.assert_allclose(points.points_m[: len(needle), 1], needle, atol=1e-12)
    sigma = out.read_torques("balancing_torque/predicted_sigma").torque_Nm
    assert (sigma[RATE:] > 0).all()


def test_one_torque_stamped_far_ahead_costs_few_residuals(bag: Path, replayed: Path, tmp_path: Path) -> None:
    source, day = open_bag(bag), 86_400 * 10**9
    torques = source.read_torques()
    stamps = torques.stamps.copy()
    stamps[400] += day
    with BagWriter(tmp_path / "ahead") as out:
        out.copy_topic(source, "main_shaft/angle")
        out.write_wrenches("balancing_torque/measured", stamps, torques.torque_Nm, log_times_ns=torques.stamps)
    assert main(["replay", str(tmp_path / "ahead"), "--machine", "tufting", "--out", str(tmp_path / "out")]) == 0
    given = open_bag(tmp_path / "out").read_torques("balancing_torque/residual").stamps
    usual = open_bag(replayed).read_torques("balancing_torque/residual").stamps
    assert set(usual) - set(given) <= set(torques.stamps[400:410])


def test_replay_gives_the_residual_at_the_measured_stamps(bag: Path, replayed: Path) -> None:
    out, measured = open_bag(replayed), open_bag(bag).read_torques()
    predicted, residual = out.read_torques("balancing_torque/predicted"), out.read_torques("balancing_torque/residual")
    assert np.isin(residual.stamps, measured.stamps).all()
    assert len(residual) > 0.98 * len(measured)
    at = np.searchsorted(measured.stamps, residual.stamps)
    origin = predicted.stamps[0]
    expected = measured.torque_Nm[at] - np.interp(
        (residual.stamps - origin) * 1e-9, (predicted.stamps - origin) * 1e-9, predicted.torque_Nm
    )
    np.testing.assert_allclose(residual.torque_Nm, expected, atol=1e-9)


def test_replay_copies_the_inputs_as_they_are(bag: Path, replayed: Path) -> None:
    before, after = open_bag(bag), open_bag(replayed)
    for name, topic in before.topics.items():
        assert after.topics[name] == topic
        old, new = (list(opened.raw_messages([name])) for opened in (before, after))
        assert old == new
    assert after.metadata["made"] == "for a test"
    assert after.metadata["machine"] == "tufting"
    with AnyReader([replayed]) as reader:
        count = sum(1 for _ in reader.messages())
    assert count == after.message_count


def test_a_replay_of_a_replay_replaces_the_predictions(replayed: Path, tmp_path: Path) -> None:
    assert main(["replay", str(replayed), "--machine", "tufting", "--out", str(tmp_path / "b.mcap")]) == 0
    first, second = open_bag(replayed), open_bag(tmp_path / "b.mcap")
    assert {name: topic.count for name, topic in first.topics.items()} == {
        name: topic.count for name, topic in second.topics.items()
    }


def test_replay_keeps_the_namespace(tmp_path: Path) -> None:
    bag = _write(tmp_path / "b", prefix="/mill/tufter_3")
    assert main(["replay", str(bag), "--machine", "tufting", "--out", str(tmp_path / "out")]) == 0
    assert "/mill/tufter_3/balancing_torque/residual" in open_bag(tmp_path / "out").topics


def test_one_of_several_machines_in_a_recording(tmp_path: Path, bag: Path) -> None:
    """Check that the topics beside the named shaft angle are used."""
    both = tmp_path / "both"
    source = open_bag(bag)
    with BagWriter(both) as out:
        for machine in ("/tufter_1", "/tufter_2"):
            for topic in ("main_shaft/angle", "balancing_torque/measured"):
                info = source.find_topic(topic)
                out.add_topic(f"{machine}/{topic}", info.msgtype)
                for block in source.blocks(topic):
                    out.write_block(f"{machine}/{topic}", block)
    chosen = ["--machine", "tufting", "--angle-topic", "/tufter_2/main_shaft/angle"]
    assert main(["compare", str(both), "--machine", "tufting"]) == 2
    assert main(["replay", str(both), *chosen, "--out", str(tmp_path / "out")]) == 0
    topics = open_bag(tmp_path / "out").topics
    assert "/tufter_2/balancing_torque/residual" in topics
    assert "/tufter_1/balancing_torque/residual" not in topics
    assert main(["compare", str(tmp_path / "out"), *chosen, "--predicted", "recorded"]) == 0


def _compare(tmp_path: Path, bag: Path, *more: str) -> dict[str, Any]:
    out = tmp_path / "comparison.json"
    assert main(["compare", str(bag), "--machine", "tufting", "--json", str(out), *more]) == 0
    result: dict[str, Any] = json.loads(out.read_text())
    return result


def test_compare_finds_noise_and_delay(tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = _compare(tmp_path, bag)
    torque, samples = result["torque"], result["samples"]
    assert torque["rms_error_Nm"] == pytest.approx(NOISE, rel=0.25)
    assert torque["delay_s"] == pytest.approx(DELAY + 0.0003, abs=1e-4)
    assert torque["correlation"] > 0.9999
    assert torque["rms_over_peak"] == pytest.approx(torque["rms_error_Nm"] / PEAK, rel=0.02)
    assert samples["used"] + samples["rejected"] == RATE * SECONDS
    assert result["revolutions"] == pytest.approx(OMEGA * SECONDS / (2 * np.pi), abs=0.5)
    text = capsys.readouterr().out
    assert "zero or delay" in text  # at one speed


@pytest.mark.slow
def test_recorded_predictions_are_those_computed(tmp_path: Path, replayed: Path) -> None:
    live = _compare(tmp_path, replayed, "--predicted", "recorded", "--shaft", "causal")
    again = _compare(tmp_path, replayed, "--predicted", "recomputed", "--shaft", "causal")
    assert live["predicted"] == "recorded"
    for part in ("configured", "fitted"):
        assert live["torque"].pop(part) == pytest.approx(again["torque"].pop(part), rel=1e-9, abs=1e-9)
    assert live["torque"] == pytest.approx(again["torque"], rel=1e-9, abs=1e-9)
    assert live["samples"]["used"] == again["samples"]["used"]


@pytest.mark.slow
def test_recorded_predictions_of_another_machine_are_reported(tmp_path: Path, replayed: Path) -> None:
    own, other = (
        _compare(tmp_path, replayed, "--predicted", "recorded", *options)["notes"]
        for options in ((), ("--set", "m6_kg=15"))
    )
    assert [note for note in other if note not in own]


@pytest.mark.slow
def test_compare_writes_all_it_was_asked_for_or_nothing(tmp_path: Path, bag: Path) -> None:
    files = [tmp_path / f"c.{form}" for form in ("json", "rrd", "png")]
    options = [word for file in files for word in (f"--{file.suffix[1:]}", str(file))]
    assert main(["compare", str(bag), "--machine", "tufting", *options]) == 0
    assert all(file.stat().st_size > 1000 for file in files)
    assert sorted(tmp_path.iterdir()) == sorted(files)
    for file in files:
        file.unlink()
    (tmp_path / "file").write_text("no folder")
    lost = str(tmp_path / "file" / "d.png")
    assert main(["compare", str(bag), "--machine", "tufting", "--json", str(files[0]), "--png", lost]) == 2
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_bad_angles_stop_the_work_or_are_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = _write(tmp_path / "b", {"700": np.nan, "701": np.inf})
    for command in (["replay", "--out", str(tmp_path / "out")], ["compare", "--json", str(tmp_path / "c.json")]):
        assert main([command[0], str(bag), "--machine", "tufting", *command[1:]]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert f"sample 700 (1.400 s after the first) is nan, 2 such of {RATE * SECONDS}" in error
    assert [entry.name for entry in tmp_path.iterdir()] == ["b"]
    counted = _compare(tmp_path, bag, "--skip-bad-samples")
    assert counted["samples"]["rejected_by_cause"]["angle_not_finite"] == 2


def test_a_stamp_far_ahead_stops_the_work_or_is_counted(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Use a stamp that would discard every later sample for an hour."""
    angles, leapt = open_bag(bag).read_angles(), tmp_path / "leapt"
    stamps = angles.stamps.copy()
    stamps[700] += 3600 * 10**9
    torque = open_bag(bag).read_torques("balancing_torque/measured")
    with BagWriter(leapt) as out:
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], angles.angles_rad)
        out.write_wrenches("balancing_torque/measured", torque.stamps, torque.torque_Nm)
    assert main(["compare", str(leapt), "--machine", "tufting", "--json", str(tmp_path / "c.json")]) == 2
    said = "the stamp of sample 700 is 3599.998 s later than that of the next, 1 such of"
    assert said in capsys.readouterr().err
    counted = _compare(tmp_path, leapt, "--skip-bad-samples")
    assert counted["samples"]["rejected_by_cause"]["angle_not_finite"] == 1
    assert counted["samples"]["rejected_by_cause"].get("angle_older_stamp", 0) == 0


def _no_bag(folder: Path) -> Path:
    path = folder / "in.mcap"
    path.write_text("no bag at all")
    return path


def _empty_bag(folder: Path) -> Path:
    with BagWriter(folder / "in") as out:
        out.add_topic("main_shaft/angle", "sensor_msgs/msg/JointState")
        out.add_topic("balancing_torque/measured", "geometry_msgs/msg/WrenchStamped")
    return folder / "in"


def _only_nan(folder: Path) -> Path:
    return _write(folder / "in", {str(k): np.nan for k in range(RATE * SECONDS)})


def _two_samples(folder: Path) -> Path:
    with BagWriter(folder / "in") as out:
        stamps = EPOCH + np.array([0, 2_000_000])
        out.write_joint_states("main_shaft/angle", stamps, ["main_shaft"], np.array([0.0, 0.03]))
        out.write_wrenches("balancing_torque/measured", stamps, np.array([1.0, 2.0]))
    return folder / "in"


@pytest.mark.parametrize("command", ["replay", "compare"])
@pytest.mark.parametrize(
    ("make", "more", "says"),
    [
        (_no_bag, [], "not a bag"),
        (lambda folder: folder / "in", [], "no such file"),
        (_empty_bag, [], "the bag is empty"),
        (lambda folder: _write(folder / "in", angle=False), [], "no topic /main_shaft/angle; topics there: "),
        (lambda folder: _write(folder / "in"), ["--angle-topic", "/balancing_torque/measured"], "WrenchStamped"),
        (lambda folder: _write(folder / "in"), ["--joint", "motor"], "joint 'motor'; joints there: main_shaft"),
        (_only_nan, ["--skip-bad-samples"], "no angle is a finite number"),
        (_two_samples, [], "too few samples"),
        (_two_samples, ["--shaft-lag", "0.1"], "--shaft-lag belongs to --shaft lag"),
        (_two_samples, ["--machine", "tuftin"], "did you mean tufting"),
    ],
)
def test_a_bad_recording_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, make: Any, more: list[str], says: str
) -> None:
    bag = make(tmp_path)
    before = sorted(tmp_path.iterdir())
    out = ["--out", str(tmp_path / "out")] if command == "replay" else ["--json", str(tmp_path / "c.json")]
    assert main([command, str(bag), "--machine", "tufting", *out, *more]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert says in error
    assert sorted(tmp_path.iterdir()) == before


def test_the_topics_there_are_listed_with_their_types(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = _write(tmp_path / "b", angle=False)
    main(["replay", str(bag), "--machine", "tufting", "--out", str(tmp_path / "out")])
    torque = f"/balancing_torque/measured (geometry_msgs/msg/WrenchStamped, {RATE * SECONDS})"
    assert f"topics there: {torque}, /mill/humidity (mill_msgs/msg/Air, 1)" in capsys.readouterr().err


def test_an_existing_output_is_replaced_only_if_forced(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(bag, tmp_path / "out")
    command = ["replay", str(bag), "--machine", "tufting", "--out", str(tmp_path / "out")]
    assert main(command) == 2
    assert "--force" in capsys.readouterr().err
    assert (tmp_path / "out" / "metadata.yaml").read_bytes() == (bag / "metadata.yaml").read_bytes()
    (tmp_path / "out" / "precious.txt").write_text("keep")
    assert main([*command, "--force"]) == 2
    assert "precious.txt" in capsys.readouterr().err
    (tmp_path / "out" / "precious.txt").unlink()
    assert main([*command, "--force"]) == 0
    assert sorted(entry.name for entry in (tmp_path / "out").iterdir()) == ["metadata.yaml", "out_0.mcap"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("room", [0, 5_000, 40_000])
@pytest.mark.parametrize(
    "command",
    [
        ["replay", "{bag}", "--machine", "tufting"],
        ["recover", "{bag}"],
        ["simulate", "tufting", "--rpm", "160", "--samples", "20000"],
    ],
)
def test_a_full_disk_names_the_output(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str], command: list[str], room: int
) -> None:
    out = tmp_path / "out.mcap"
    with full_disk(room):
        assert main([word.format(bag=bag) for word in command] + ["--out", str(out)]) == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("\r")]
    assert str(out) in line
    assert not list(tmp_path.iterdir())


_STOPPED = """
import os, signal, sys, time
import textile_twin_core.recordings.replay as replay
from textile_twin_core.cli.main import main

def stopped_halfway(bag, out, *_, **__):
    out.copy_topic(bag, "main_shaft/angle")
    assert len(os.listdir(os.path.dirname(sys.argv[-1]))) == 1
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(60)

replay.replay_bag = stopped_halfway
sys.exit(main())
"""


def test_a_stopped_command_takes_its_half_written_file_away(tmp_path: Path, bag: Path) -> None:
    arguments = ["replay", str(bag), "--machine", "tufting", "--out", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", _STOPPED, *arguments], check=False, timeout=120, stderr=subprocess.PIPE
    )
    assert (done.returncode, done.stderr) == (128 + signal.SIGTERM, b"")
    assert list(tmp_path.iterdir()) == []


def test_a_cut_off_recording_is_read_with_a_notice_and_recovered(
    tmp_path: Path, bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut"
    shutil.copytree(bag, cut)
    (cut / "metadata.yaml").unlink()
    file = next(cut.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 9 // 10])
    assert main(["recover", str(cut), "--out", str(tmp_path / "whole")]) == 0
    assert "cut off" in capsys.readouterr().err
    recovered = open_bag(tmp_path / "whole")
    assert not recovered.truncated
    assert recovered.topics == open_bag(cut).topics
    np.testing.assert_array_equal(recovered.read_angles().angles_rad, open_bag(bag).read_angles().angles_rad)
