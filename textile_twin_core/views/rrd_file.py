"""Files of the viewer that are either complete or reported as failed.

On a full disk the viewer's own writer stops, logs it and leaves half a file, or blocks on the remaining data. Here the
viewer writes into a pipe, and a thread of ours copies the pipe into the file and notices each error.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import rerun as rr
import rerun.blueprint as rrb

from textile_twin_core.errors import RecordingError
from textile_twin_core.views.drawable import drawable

_PIPES = Path("/dev/fd")
"""Directory that names open pipes; without it the viewer writes the file directly."""
_CHUNK = 1 << 20
_BEGIN, _END, _LAST = b"RRF", b"FOOT", 64
"""First bytes of a file, marker within its last bytes, and how many last bytes to search."""


class RrdFile:
    """An .rrd file while it is written; an existing file is replaced at once.

    Raises:
        RecordingError: The file cannot be written there.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self._error = Path(path), ""
        try:
            self._file = self._path.open("wb", buffering=0)
        except OSError as error:
            raise RecordingError(f"cannot write {path}: {error.strerror or error}") from error
        self._copier = Thread(target=self._copy, name="rrd file", daemon=True)

    @property
    def error(self) -> RecordingError | None:
        """Reason why the file is incomplete; None while writing succeeds."""
        return RecordingError(f"cannot write {self._path}: {self._error}") if self._error else None

    def attach(self, save: Callable[[str], object]) -> None:
        """Start writing; call `save` with the file name that the viewer's writer has to use."""
        if not _PIPES.exists():
            self._file.close()
            save(str(self._path))
            return
        self._source, end = os.pipe()
        self._copier.start()
        try:
            save(f"{_PIPES}/{end}")
        finally:
            os.close(end)

    def finish(self) -> None:
        """Wait for the end of the file, after its stream is disconnected.

        Raises:
            RecordingError: The file is incomplete.
        """
        if self._copier.ident is not None:
            self._copier.join()
        if self.error is not None:
            raise self.error

    def _copy(self) -> None:
        with self._file:
            while chunk := memoryview(os.read(self._source, _CHUNK)):
                try:
                    while chunk and not self._error:
                        chunk = chunk[self._file.write(chunk) :]
                except OSError as error:  # keep reading the pipe, so that the viewer's writer does not block
                    self._error = error.strerror or str(error)
        os.close(self._source)


def check_whole(path: Path) -> None:
    """Check that a file is a complete recording; the viewer would wait for the rest of a truncated one.

    Raises:
        RecordingError: The file is missing, truncated or not a recording of the viewer.
    """
    try:
        with path.open("rb") as file:
            begin, size = file.read(len(_BEGIN)), file.seek(0, os.SEEK_END)
            file.seek(max(size - _LAST, 0))
            last = file.read()
    except FileNotFoundError:
        raise RecordingError(f"{path}: there is no such recording") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror or error})") from error
    if begin != _BEGIN:
        raise RecordingError(f"{path}: is no recording of the viewer; those are written by compare --rrd or view_node")
    if _END not in last:
        raise RecordingError(f"{path}: has no end: it is still being written, or was cut off; write it again")


@contextmanager
def written(stream: rr.RecordingStream, path: str | os.PathLike[str], blueprint: rrb.Blueprint) -> Iterator[None]:
    """Write the data logged into a stream within the `with` block as an .rrd file.

    Raises:
        RecordingError: The file cannot be written there, or not to its end.
    """
    file = RrdFile(path)
    try:
        file.attach(lambda name: stream.save(name, default_blueprint=blueprint))
        yield
    finally:
        stream.disconnect()
    file.finish()


def write_picture(path: Path, picture: Path, *, title: str) -> Path:
    """Write an .rrd file that shows a .png file, and return its path.

    Raises:
        RecordingError: The file cannot be written there.
    """
    title = drawable(title)
    stream = rr.RecordingStream("textile-twin", recording_id=title)
    layout = rrb.Blueprint(rrb.Spatial2DView(origin="/", name=title), collapse_panels=True)
    with written(stream, path, layout):
        stream.log("picture", rr.EncodedImage(path=picture), static=True)
    return path
