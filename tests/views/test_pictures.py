"""Tests of the viewer without a display: curves and machine are drawn, and the machine moves."""

from __future__ import annotations

import ctypes.util
import shutil
import socket
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import rerun as rr
import rerun.blueprint as rrb
from PIL import Image

import textile_twin_core as ttc
from tests.views.conftest import Run
from tests.views.test_live import PATIENCE_S, feed, free_port
from textile_twin_core.cli.main import main
from textile_twin_core.errors import RecordingError, TwinError
from textile_twin_core.views import LiveView, open_viewer, palette, screenshot, screenshots, write_comparison_recording
from textile_twin_core.views.drawable import drawable, drawable_machine
from textile_twin_core.views.rrd_file import written
from textile_twin_core.views.viewer import _reason, ask_repeatedly

Pixels = npt.NDArray[np.int64]

DRIVERS = [*Path("/usr/share/vulkan/icd.d").glob("*.json"), *Path("/etc/vulkan/icd.d").glob("*.json")]
needs_vulkan = pytest.mark.skipif(
    ctypes.util.find_library("vulkan") is None or not DRIVERS,
    reason="no Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1",
)

# Regions of the 1920 x 1080 window: (left, top, right, bottom).
MACHINE = (0, 70, 490, 800)
TORQUE = (515, 75, 1915, 335)
RESIDUAL = (515, 385, 1915, 520)
PHASE = (495, 570, 1915, 665)
OVER_ANGLE = (500, 720, 1050, 1020)
BY_ANGLE = (1090, 720, 1500, 1020)


def pixels(picture: Path) -> Pixels:
    return np.asarray(Image.open(picture).convert("RGB"), dtype=np.int64)


def part(image: Pixels, box: tuple[int, int, int, int]) -> Pixels:
    return image[box[1] : box[3], box[0] : box[2]]


def columns_of(image: Pixels, colour: palette.Colour, near: int = 40) -> int:
    """Return the columns of an image that contain the colour: the extent of a curve, however thin."""
    return int(np.count_nonzero((np.abs(image - np.array(colour)).max(axis=2) < near).any(axis=0)))


@pytest.mark.slow
@needs_vulkan
def test_curves_and_machine_are_drawn_and_the_machine_moves(run: Run, tmp_path: Path) -> None:
    recording = write_comparison_recording(tmp_path / "run.rrd", run.comparison, run.machine, title="a test")
    first, second = (
        pixels(picture)
        for picture in screenshots(recording, [(4.0, tmp_path / "first.png"), (4.1, tmp_path / "second.png")])
    )
    assert first.shape == (1080, 1920, 3)
    assert columns_of(part(first, TORQUE), palette.MEASURED) > 200
    assert columns_of(part(first, TORQUE), palette.PREDICTED) > 800
    assert columns_of(part(first, RESIDUAL), palette.RESIDUAL) > 400
    assert columns_of(part(first, PHASE), palette.IN_BACKING) > 300
    assert columns_of(part(first, OVER_ANGLE), palette.PREDICTED) > 150
    assert columns_of(part(first, OVER_ANGLE), palette.MEASURED, near=60) > 100
    assert columns_of(part(first, BY_ANGLE), palette.NOW) > 200
    moved = np.abs(part(first, MACHINE) - part(second, MACHINE)).max(axis=2) > 30
    assert 500 < np.count_nonzero(moved) < 0.5 * moved.size
    drawn = np.abs(part(first, MACHINE) - np.array(palette.BACKGROUND)).max(axis=2) > 30
    assert np.count_nonzero(drawn) > 0.05 * drawn.size


@pytest.mark.slow
@needs_vulkan
def test_a_viewer_that_joins_late_sees_the_live_view(run: Run, tmp_path: Path) -> None:
    with LiveView(run.machine, port=free_port(), flush_s=0.05) as view:
        feed(view, run, pause_s=0.005)
        assert view.url is not None
        image = pixels(screenshot(view.url, tmp_path / "live.png", time_s=5.5))
    assert view.error is None
    assert columns_of(part(image, TORQUE), palette.MEASURED) > 200
    assert columns_of(part(image, TORQUE), palette.PREDICTED) > 800
    assert columns_of(part(image, OVER_ANGLE), palette.PREDICTED) > 150


@needs_vulkan
def test_no_viewer_is_left_behind(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STARTED_BY", str(tmp_path))
    recording = write_comparison_recording(tmp_path / "run.rrd", run.comparison, run.machine, title="a test")
    screenshot(recording, tmp_path / "run.png", size=(640, 400))
    assert Image.open(tmp_path / "run.png").size == (640, 400)
    end = time.monotonic() + PATIENCE_S
    while (left := started_by(tmp_path)) and time.monotonic() < end:
        time.sleep(0.2)
    assert left == []


def started_by(mark: Path) -> list[bytes]:
    """Return the commands of the living processes that inherited the mark."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if f"STARTED_BY={mark}".encode() in (process / "environ").read_bytes():
                found.append((process / "cmdline").read_bytes())
    return found


def test_a_viewer_that_ends_is_one_line(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        monkeypatch.setenv(name, str(tmp_path / "none.json"))
    recording = write_comparison_recording(tmp_path / "run.rrd", run.comparison, run.machine, title="a test")
    with pytest.raises(TwinError, match=r"the viewer ended with code \d+; it needs a graphics driver \(Vulkan\)"):
        screenshot(recording, tmp_path / "run.png")


@pytest.mark.slow
@needs_vulkan
def test_names_that_the_viewers_font_lacks_are_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A Chinese machine and folder, and a character that the file itself holds."""
    machine = tmp_path / "machine.yaml"
    machine.write_text("machine: tufting\nname: 簇绒机\n", encoding="utf-8")
    bag = shutil.copytree("bags/tufting_160rpm_synthetic", tmp_path / "رقم 한")
    assert main(["view", str(bag), "--machine", str(machine), "--png", str(tmp_path / "v.png")]) == 0
    assert "drawn as U7C07 U7ED2 U673A" in capsys.readouterr().err
    assert Image.open(tmp_path / "v.png").size == (1920, 1080)
    recording = tmp_path / "rec.rrd"
    stream = rr.RecordingStream("textile-twin")
    with written(stream, recording, rrb.Blueprint(rrb.TextDocumentView(origin="/text"))):
        stream.log("text", rr.TextDocument("織機"), static=True)
    with pytest.raises(TwinError, match=r"its font has no character .織. \(U\+7E54\)") as error:
        screenshot(recording, tmp_path / "rec.png")
    assert "driver" not in str(error.value)


def test_only_a_missing_driver_is_blamed_on_the_driver() -> None:
    assert "Vulkan" in _reason(["Error: no suitable graphics adapter found"], failed=True)
    assert "Vulkan" not in _reason(["thread 'main' panicked at: out of memory"], failed=True)


def test_names_are_drawn_by_their_numbers_and_stay_different() -> None:
    assert drawable("Größe α → ж 1.2 N·m") == "Größe α U2192 ж 1.2 N·m"
    machine = ttc.load_machine("examples/six_bar_loom.yaml")
    assert drawable_machine(machine) == (machine, "")
    named, replaced = drawable_machine(replace(machine, name="織機", description="a loom"))
    assert (named.name, replaced) == ("U7E54U6A5F", "織機") and replace(
        named, name=machine.name
    ).groups == machine.groups


def test_a_viewer_whose_transport_fails_for_a_moment_is_asked_again() -> None:
    port = free_port()
    server = "import socket, sys, time; time.sleep(1.5); socket.create_server(('127.0.0.1', int(sys.argv[1]))).accept()"
    with subprocess.Popen([sys.executable, "-c", server, str(port)]) as process:
        ask_repeatedly(
            process, "answer", PATIENCE_S, lambda: socket.create_connection(("127.0.0.1", port), 1.0).close()
        )
        assert process.wait() == 0
        with pytest.raises(TwinError, match="the viewer ended with code 0"):
            ask_repeatedly(process, "answer", PATIENCE_S, lambda: socket.create_connection(("127.0.0.1", port), 1.0))


def test_a_viewer_that_is_ended_or_too_slow_is_reported_in_our_words() -> None:
    """Check that the message is ours and not that of the transport."""

    def fail() -> None:
        raise RuntimeError('status: Unavailable, message: "transport error", details: [], metadata: MetadataMap {}')

    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as process:
        with pytest.raises(TwinError) as slow:
            ask_repeatedly(process, "show it at 3 s", 0.3, fail)
        assert str(slow.value) == (
            "the viewer did not show it at 3 s in 0.3 s: try again when the computer has less to do"
        )
        process.terminate()
        process.wait()
        with pytest.raises(TwinError) as ended:
            ask_repeatedly(process, "show it at 3 s", 30.0, fail)
    assert str(ended.value) == "the viewer was ended by signal 15 (Terminated); draw it again"


def test_a_missing_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"none\.rrd: there is no such recording"):
        open_viewer(tmp_path / "none.rrd")
    with pytest.raises(RecordingError):
        screenshot(tmp_path / "none.rrd", tmp_path / "none.png")
