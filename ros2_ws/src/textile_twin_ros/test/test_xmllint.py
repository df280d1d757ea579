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

"""The manifest and the layouts, by ament_xmllint."""

from __future__ import annotations

from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent


def test_xmllint(capfd: pytest.CaptureFixture[str]) -> None:
    linter = pytest.importorskip("ament_xmllint.main")
    if linter.shutil.which("xmllint") is None:
        pytest.skip("no xmllint: apt-get install libxml2-utils")
    code = linter.main(argv=[str(PACKAGE)])
    words = "".join(capfd.readouterr())
    if "Failed to locate the main schema resource" in words:
        pytest.skip("no network: the schema of package.xml is at download.ros.org")
    assert code == 0, words
