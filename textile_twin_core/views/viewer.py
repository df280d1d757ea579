"""Opening of a recording in the rerun viewer, and screenshots without a display."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from rerun.experimental import ViewerClient

from textile_twin_core.errors import TwinError, how_to_install
from textile_twin_core.views.drawable import drawable, undrawable
from textile_twin_core.views.rrd_file import check_whole

_NEEDS = "it needs a graphics driver (Vulkan), such as the package mesa-vulkan-drivers"
_DRIVER = re.compile("adapter|wgpu|vulkan|graphics", re.IGNORECASE)
_NO_GLYPH = re.compile(r'No glyph for ("." \(U\+[0-9A-F]+\))')
_BUSY = "try again when the computer has less to do"
_T = TypeVar("_T")
_START_S = 60.0
_LOAD_S = 120.0
_PICTURE_S = 180.0


def open_viewer(path: str | os.PathLike[str]) -> subprocess.Popen[bytes]:
    """Open an .rrd recording in the viewer, which outlives this program.

    Raises:
        RecordingError: The file is missing or incomplete.
        TwinError: The viewer is not installed.
    """
    recording = Path(path)
    check_whole(recording)
    # The viewer accepts data from other programs; restrict it to loopback.
    command = [str(_program()), "--bind", "127.0.0.1", "--hide-welcome-screen", str(recording)]
    return subprocess.Popen(command, start_new_session=True)


def screenshot(
    source: str | os.PathLike[str],
    picture: str | os.PathLike[str],
    *,
    time_s: float | None = None,
    size: tuple[int, int] = (1920, 1080),
) -> Path:
    """Save a picture of a recording as PNG, as the viewer shows it. Needs Vulkan but no display.

    Args:
        source: An .rrd file, or the address of a live view.
        picture: The PNG to write.
        time_s: Time of the cursor [s]; the end of the recording by default.
        size: Width and height of the window in pixels.

    Returns:
        The path of the picture.

    Raises:
        RecordingError: The file is missing or incomplete.
        TwinError: The viewer does not start, or does not draw in time.
    """
    return screenshots(source, [(time_s, picture)], size=size)[0]


def screenshots(
    source: str | os.PathLike[str],
    pictures: Sequence[tuple[float | None, str | os.PathLike[str]]],
    *,
    size: tuple[int, int] = (1920, 1080),
) -> list[Path]:
    """Save several pictures of one recording, each (time [s], PNG to write), with one start of the viewer.

    Raises:
        RecordingError: The file is missing or incomplete.
        TwinError: The viewer does not start, or does not draw in time.
    """
    address = str(source)
    if "://" not in address:
        check_whole(Path(source))
        address = str(Path(source).resolve())
    port = _free_port()
    command = [str(_program()), "--headless", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"]
    command += ["--window-size", f"{size[0]}x{size[1]}"]
    with tempfile.TemporaryDirectory(prefix="viewer-") as home, tempfile.TemporaryFile() as log:
        if undrawable(Path(address).name):  # the viewer shows the file's name
            shown = Path(home) / drawable(Path(address).name)
            shown.symlink_to(address)
            address = str(shown)
        # A private home without stored settings, so that the picture shows the recorded layout.
        place = {**os.environ, "HOME": home, "XDG_CONFIG_HOME": home, "XDG_CACHE_HOME": home, "XDG_DATA_HOME": home}
        # A process group of its own, since the program is a launcher and the viewer its child.
        viewer = subprocess.Popen(command, env=place, stdout=log, stderr=log, start_new_session=True)
        try:
            client = _connect(viewer, port)
            _load(viewer, client, address)
            images = [_picture(viewer, client, time_s) for time_s, _ in pictures]
        except TwinError as error:
            log.seek(0)
            said = log.read().decode(errors="replace").strip().splitlines()
            failed = (viewer.poll() or 0) > 0  # otherwise its last line only reports a closed connection
            raise TwinError(f"{source}: {error}{_reason(said, failed)}") from error
        finally:
            _end(viewer)
    targets = [Path(target) for _, target in pictures]
    for target, image in zip(targets, images, strict=True):
        target.write_bytes(image)
    return targets


def _reason(said: Sequence[str], failed: bool) -> str:
    """Explain from the viewer's log why it ended."""
    missing = next((found for line in said if (found := _NO_GLYPH.search(line))), None)
    if missing is not None:
        return f": its font has no character {missing[1]}; rename what bears it, a machine, a measure or a signal"
    last = [line for line in said if "panicked" in line] or (said[-1:] if failed else [])
    driver = f"; {_NEEDS}" if any(_DRIVER.search(line) for line in said) else ""
    return f"{driver}{f' ({last[0]})' if last else ''}"


def _end(viewer: subprocess.Popen[bytes]) -> None:
    """End the launcher and the viewer."""
    for how in (signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(viewer.pid, how)
        with suppress(subprocess.TimeoutExpired):
            viewer.wait(timeout=5.0)


def ask_repeatedly(viewer: subprocess.Popen[bytes], what: str, seconds: float, ask: Callable[[], _T]) -> _T:
    """Return the viewer's answer; repeat the request while its transport fails, as on a busy machine.

    Raises:
        TwinError: The viewer has ended, or has not answered in time.
    """
    end = time.monotonic() + seconds
    while True:
        try:
            return ask()
        except Exception as error:  # the client passes on the exceptions of its transport
            if viewer.poll() is not None:
                raise TwinError(_ended(viewer.returncode)) from error
            if time.monotonic() > end:
                raise TwinError(f"the viewer did not {what} in {seconds:g} s: {_BUSY}") from error
        time.sleep(0.2)


def _ended(code: int) -> str:
    """Describe how the viewer ended, and what to do."""
    if code >= 0:
        return f"the viewer ended with code {code}"
    return f"the viewer was ended by signal {-code} ({signal.strsignal(-code)}); draw it again"


def _load(viewer: subprocess.Popen[bytes], client: ViewerClient, address: str) -> None:
    ask_repeatedly(viewer, "open it", _LOAD_S, lambda: client.open(address))
    end = time.monotonic() + _LOAD_S
    while True:
        state = ask_repeatedly(viewer, "load it", _LOAD_S, client.get_state)
        if state.active_recording is not None and not state.loading:
            return
        if time.monotonic() > end:
            raise TwinError(f"the viewer did not load it in {_LOAD_S:g} s: {_BUSY}")
        time.sleep(0.1)


def _picture(viewer: subprocess.Popen[bytes], client: ViewerClient, time_s: float | None) -> bytes:
    if time_s is not None:
        # The viewer refuses this until data have arrived.
        what = f"show it at {time_s:g} s"
        ask_repeatedly(viewer, what, _LOAD_S, lambda: client.set_time("time", duration=time_s, play_state="paused"))
    time.sleep(1.0)
    # The first pictures show empty plots: wait until three in a row are the same.
    last: list[bytes] = []
    end = time.monotonic() + _PICTURE_S
    while len(last) < 3 or len(set(last)) > 1:
        if time.monotonic() > end:
            raise TwinError(f"the viewer did not draw it in {_PICTURE_S:g} s: {_BUSY}")
        last = [*last, ask_repeatedly(viewer, "draw it", _PICTURE_S, client.take_screenshot)][-3:]
        time.sleep(0.3)
    return last[-1]


def _connect(viewer: subprocess.Popen[bytes], port: int) -> ViewerClient:
    def connected() -> ViewerClient:
        with socket.create_connection(("127.0.0.1", port), timeout=1.0):
            pass
        client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        client.get_state()
        return client

    return ask_repeatedly(viewer, "answer", _START_S, connected)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _program() -> Path:
    program = Path(sys.executable).with_name("rerun")
    if not program.exists():
        raise TwinError(f"the rerun viewer is not installed beside {sys.executable}: {how_to_install('rerun')}")
    return program
