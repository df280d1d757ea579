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

"""Copyright and licence of every source file, by ament_copyright."""

from __future__ import annotations

from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent


def test_copyright() -> None:
    linter = pytest.importorskip("ament_copyright.main")
    assert linter.main(argv=[str(PACKAGE)]) == 0


def test_every_source_file_names_its_licence() -> None:
    """The same without a ROS installation, and the SPDX line."""
    files = [file for file in PACKAGE.rglob("*.py") if "build" not in file.relative_to(PACKAGE).parts]
    assert len(files) > 40
    for file in files:
        head = file.read_text(encoding="utf-8")[:800]
        assert head.startswith("# Copyright 2026 textile-twin contributors\n"), file
        assert "\n# SPDX-License-Identifier: Apache-2.0\n" in head, file
