# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Folder of a recording: the given one, or one of its own, named by date, time and machine."""

from __future__ import annotations

import re
import shutil
import time
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from textile_twin_core.errors import RecordingError

if TYPE_CHECKING:
    from textile_twin_core.recordings import BagWriter

_TIME_PATTERN = r"\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d"


class RecordingPath:
    """Gives each recording of a node its path.

    Args:
        bag: the first one's path; later ones get _2, _3 and so on.
        folder: where there is no such path: the folder in which recordings are named by their time.
        namespace: the machine's namespace, which then is part of the name, too.

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

    def take_next(self) -> Path:
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

    def retain(self, writer: BagWriter, most_bytes: int) -> list[str]:
        """Limit the recordings to `most_bytes`: the folder's oldest recordings go first, then this one's oldest files.

        Recordings of other machines in the folder count for themselves; what has no metadata.yaml is being written.
        What could not be removed, one line each, as where somebody else's recordings are.
        """
        kept, stuck = writer.bytes_kept, []
        for path in self._earlier(writer.path) if self.by_time else []:
            try:
                kept += _size(path)
                if kept > most_bytes:
                    _remove_recording(path)
            except OSError as error:
                stuck.append(f"{path}: cannot be removed ({error.strerror})")
        while writer.bytes_kept > most_bytes and writer.drop_oldest_file():
            pass
        return stuck

    def room_bytes(self, current: Path) -> int:
        """Bytes that recordings may take on this disk: its free space, and that of this machine's earlier ones."""
        room = shutil.disk_usage(current.parent).free
        for path in self._earlier(current) if self.by_time else []:
            with suppress(OSError):  # what cannot be looked into cannot be removed either
                room += _size(path)
        return room

    def _earlier(self, current: Path) -> list[Path]:
        """Complete recordings of this machine in the folder, the newest first."""
        own = re.compile(_TIME_PATTERN + (f"_{re.escape(self._machine)}" if self._machine else "") + r"(_\d+)?")
        found = [path for path in self._folder.iterdir() if own.fullmatch(path.name) and path != current]
        return sorted((path for path in found if (path / "metadata.yaml").exists()), reverse=True)

    def _named_by_time(self) -> Path:
        name = time.strftime("%Y-%m-%d_%H-%M-%S")
        return self._folder / (f"{name}_{self._machine}" if self._machine else name)


def _size(path: Path) -> int:
    return sum(entry.lstat().st_size for entry in path.iterdir())


def _remove_recording(path: Path) -> None:
    """Remove the files of a recording; metadata.yaml goes last, as it marks a complete one."""
    for entry in (*path.glob("*.mcap"), path / "metadata.yaml"):
        entry.unlink(missing_ok=True)
    with suppress(OSError):  # what somebody else has put there stays
        path.rmdir()


def _numbered(path: Path, number: int) -> Path:
    return path if number == 1 else path.with_name(f"{path.name}_{number}")
