"""Where recordings go: into a folder that was named, or into one of their own, named by date, time and machine."""

from __future__ import annotations

import time
from contextlib import suppress
from itertools import count
from pathlib import Path

from textile_twin_core.errors import RecordingError


class RecordingPlace:
    """Gives each recording of a node its path.

    Args:
        bag: the first one's path; later ones get _2, _3 and so on.
        folder: where there is no such path: the folder in which recordings are named by their time.
        namespace: the machine's namespace, which then stands in the name, too.

    Raises:
        RecordingError: neither is given.
    """

    def __init__(self, bag: str, folder: str, namespace: str) -> None:
        if not bag and not folder:
            raise RecordingError(
                "parameter 'bag' is not set: give the folder to write, -p bag:=FOLDER, or with -p folder:=FOLDER one"
                " that takes recordings named by their time"
            )
        self.by_time = not bag
        self._bag, self._folder = Path(bag), Path(folder)
        self._machine = namespace.strip("/").replace("/", "_")
        self._given = 0

    def next(self) -> Path:
        """The next recording's path; one named by its time is a new, empty folder that no other process gets.

        Raises:
            RecordingError: nothing can be written there.
        """
        self._given += 1
        path = self._named_by_time() if self.by_time else _numbered(self._bag, self._given)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            if not self.by_time:
                return path
            for number in count(1):
                with suppress(FileExistsError):
                    _numbered(path, number).mkdir()
                    return _numbered(path, number)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be made ({error.strerror}); choose another place") from error
        raise AssertionError("there is always a free number")

    def _named_by_time(self) -> Path:
        name = time.strftime("%Y-%m-%d_%H-%M-%S")
        return self._folder / (f"{name}_{self._machine}" if self._machine else name)


def _numbered(path: Path, number: int) -> Path:
    return path if number == 1 else path.with_name(f"{path.name}_{number}")
