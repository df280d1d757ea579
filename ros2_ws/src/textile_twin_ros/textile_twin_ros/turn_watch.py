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

"""Watch over a monitor's turns: a reason where it sees none of the shaft's turns."""

from __future__ import annotations

import math

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.fault_signatures import FEWEST_TORQUES_PER_TURN
from textile_twin_ros.diagnostics import WARN, WINDOW_S
from textile_twin_ros.health import Finding, apart_text

_TURNS = 5.0
"""So many turns, for as long as a level looks back, may pass unseen: the torque of some may be late."""


class TurnWatch:
    """Compares the turns of the shaft with those that were watched; fed beside the monitor, a block at a time."""

    def __init__(self) -> None:
        self._since: tuple[int, float] | None = None
        self._newest: tuple[int, float] | None = None
        self._torques = self._finite = 0
        self._apart_s = 0.0

    def look(
        self, newest: tuple[int, float] | None, watched: bool, torques: tuple[IntArray, FloatArray] | None
    ) -> None:
        """Take the result of a block.

        Args:
            newest: how far the shaft is by now: stamp [ns] and angle [rad]; None where that is not known.
            watched: whether turns were watched in it.
            torques: the stamps [ns] and torques (n,) of it, in order of time; None without any.
        """
        self._newest = newest
        if watched or self._since is None:
            self._since = newest
            self._torques = self._finite = 0
        elif torques is not None and newest is not None:
            self._torques += torques[1].size
            self._finite += int(np.count_nonzero(np.isfinite(torques[1])))
            self._apart_s = (int(torques[0][-1]) - newest[0]) * 1e-9

    def findings(self) -> list[Finding]:
        """Findings: an empty list while turns are watched, or the shaft has hardly turned since."""
        if self._since is None or self._newest is None:
            return []
        turns = abs(self._newest[1] - self._since[1]) / math.tau
        if turns < _TURNS or self._newest[0] - self._since[0] < WINDOW_S * 1e9:
            return []
        text = f"no turn watched for {turns:.0f} turns of the shaft{self._reason(turns)}"
        return [Finding("unwatched", WARN, text)]

    def _reason(self, turns: float) -> str:
        if not self._torques:
            return ": no torque comes"
        too_few = self._finite < FEWEST_TORQUES_PER_TURN * turns
        if too_few and self._finite < 0.5 * self._torques:
            return f": {self._torques - self._finite} of {self._torques} torques are not finite"
        if apart := apart_text(self._apart_s):
            return f": {apart}"
        if too_few:
            return f": {self._finite / turns:.1f} torques a turn, and at least {FEWEST_TORQUES_PER_TURN} are needed"
        return ""
