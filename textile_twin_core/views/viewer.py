"""Open a recording in the rerun viewer, or take its picture without a screen."""

from __future__ import annotations

import os
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
from textile_twin_core.views.rrd_file import check_whole

_NEEDS = "it needs a graphics driver (Vulkan), such as the package mesa-vulkan-drivers"
_BUSY = "try again when the computer has less to do"
_T = TypeVar("_T")
_START_S = 60.0
_LOAD_S = 120.0
_PICTURE_S = 180.0


def open_viewer(path: str | os.PathLike[str]) -> subprocess.Popen[bytes]:
    """Open a .rrd recording in the viewer, which runs on when this program ends.

    Raises:
        RecordingError: there is no such file, or it is not whole.
        TwinError: the viewer is not installed.
    """
    recording = Path(path)
    check_whole(recording)
    # A viewer listens for data from others: on loopback only.
    command = [str(_program()), "--bind", "127.0.0.1", "--hide-welcome-screen", str(recording)]
    return subprocess.Popen(command, start_new_session=True)


def screenshot(
    source: str | os.PathLike[str],
    picture: str | os.PathLike[str],
    *,
    time_s: float | None = None,
    size: tuple[int, int] = (1920, 1080),
) -> Path:
    """Draw a recording as the viewer shows it and save the picture as PNG. Needs no screen, but Vulkan.

    Args:
        source: a .rrd file, or the address of a live view.
        picture: the PNG to write.
        time_s: where the time cursor stands, seconds on the recording's time; its end without it.
        size: width and height of the window.

    Returns:
        The path of the picture.

    Raises:
        RecordingError: there is no such file, or it is not whole.
        TwinError: the viewer does not start, or does not draw in time.
    """
    return screenshots(source, [(time_s, picture)], size=size)[0]


def screenshots(
    source: str | os.PathLike[str],
    pictures: Sequence[tuple[float | None, str | os.PathLike[str]]],
    *,
    size: tuple[int, int] = (1920, 1080),
) -> list[Path]:
    """Several pictures of one recording, each (time [s], PNG to write), with the viewer started once.

    Raises:
        RecordingError: there is no such file, or it is not whole.
        TwinError: the viewer does not start, or does not draw in time.
    """
    address = str(source)
    if "://" not in address:
        check_whole(Path(source))
        address = str(Path(source).resolve())
    port = _free_port()
    command = [str(_program()), "--headless", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"]
    command += ["--window-size", f"{size[0]}x{size[1]}"]
    with tempfile.TemporaryDirectory(prefix="viewer-") as home, tempfile.TemporaryFile() as log:
        # The viewer keeps its settings in its own home, so that the picture is of the layout that was recorded.
        place = {**os.environ, "HOME": home, "XDG_CONFIG_HOME": home, "XDG_CACHE_HOME": home, "XDG_DATA_HOME": home}
        # In a group of its own: the program is a launcher, and the viewer its child.
        viewer = subprocess.Popen(command, env=place, stdout=log, stderr=log, start_new_session=True)
        try:
            client = _connect(viewer, port)
            _load(viewer, client, address)
            images = [_picture(viewer, client, time_s) for time_s, _ in pictures]
        except TwinError as error:
            log.seek(0)
            said = log.read().decode(errors="replace").strip().splitlines()
            failed = (viewer.poll() or 0) > 0  # else its last line is about a transport that was cut
            last = [line for line in said if "panicked" in line] or (said[-1:] if failed else [])
            raise TwinError(f"{source}: {error}{f' ({last[0]})' if last else ''}") from error
        finally:
            _end(viewer)
    targets = [Path(target) for _, target in pictures]
    for target, image in zip(targets, images, strict=True):
        target.write_bytes(image)
    return targets


def _end(viewer: subprocess.Popen[bytes]) -> None:
    """End the launcher and the viewer."""
    for how in (signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(viewer.pid, how)
        with suppress(subprocess.TimeoutExpired):
            viewer.wait(timeout=5.0)


def _patiently(viewer: subprocess.Popen[bytes], what: str, seconds: float, ask: Callable[[], _T]) -> _T:
    """What the viewer answers; asked again while its transport fails, as on a busy machine.

    Raises TwinError when the viewer has ended, or has not answered in time.
    """
    end = time.monotonic() + seconds
    while True:
        try:
            return ask()
        except Exception as error:  # the client raises what its transport raises, in words that are for its makers
            if viewer.poll() is not None:
                raise TwinError(_ended(viewer.returncode)) from error
            if time.monotonic() > end:
                raise TwinError(f"the viewer did not {what} in {seconds:g} s: {_BUSY}") from error
        time.sleep(0.2)


def _ended(code: int) -> str:
    """How the viewer ended, and what to do."""
    if code >= 0:
        return f"the viewer ended with code {code}; {_NEEDS}"
    return f"the viewer was ended by signal {-code} ({signal.strsignal(-code)}); draw it again"


def _load(viewer: subprocess.Popen[bytes], client: ViewerClient, address: str) -> None:
    _patiently(viewer, "open it", _LOAD_S, lambda: client.open(address))
    end = time.monotonic() + _LOAD_S
    while True:
        state = _patiently(viewer, "load it", _LOAD_S, client.get_state)
        if state.active_recording is not None and not state.loading:
            return
        if time.monotonic() > end:
            raise TwinError(f"the viewer did not load it in {_LOAD_S:g} s: {_BUSY}")
        time.sleep(0.1)


def _picture(viewer: subprocess.Popen[bytes], client: ViewerClient, time_s: float | None) -> bytes:
    if time_s is not None:
        # Refused, too, as long as no data have arrived.
        what = f"show it at {time_s:g} s"
        _patiently(viewer, what, _LOAD_S, lambda: client.set_time("time", duration=time_s, play_state="paused"))
    time.sleep(1.0)
    # The first pictures are of empty plots: wait until three in a row are the same.
    last: list[bytes] = []
    end = time.monotonic() + _PICTURE_S
    while len(last) < 3 or len(set(last)) > 1:
        if time.monotonic() > end:
            raise TwinError(f"the viewer did not draw it in {_PICTURE_S:g} s: {_BUSY}")
        last = [*last, _patiently(viewer, "draw it", _PICTURE_S, client.take_screenshot)][-3:]
        time.sleep(0.3)
    return last[-1]


def _connect(viewer: subprocess.Popen[bytes], port: int) -> ViewerClient:
    def connected() -> ViewerClient:
        with socket.create_connection(("127.0.0.1", port), timeout=1.0):
            pass
        client = ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        client.get_state()
        return client

    return _patiently(viewer, "answer", _START_S, connected)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _program() -> Path:
    program = Path(sys.executable).with_name("rerun")
    if not program.exists():
        raise TwinError(f"the rerun viewer is not installed beside {sys.executable}: {how_to_install('rerun')}")
    return program
