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

"""Fitness of an input: levels from samples refused, bridged or interrupted in the last seconds."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.comparison.readings import FEWEST_TORQUES_PER_TURN, other_unit
from textile_twin_core.recordings.sample_clock import even_times, find_bursts
from textile_twin_core.shaft import SampleReport
from textile_twin_ros.diagnostics import ERROR, OK, WARN, WINDOW_S, Status

WARN_SHARE = 0.01
"""Share of samples that do not serve above which there is a warning."""
ERROR_SHARE = 0.5
_LATE_S = 1.0
_NAMES_LENGTH = 200
_APART_S = 1.0
_STATE_LEVELS: dict[str, bytes] = {"waiting": WARN, "settling": WARN, "starting": WARN, "lost": ERROR}
# What leaves a sample out, and what bridges one, in the counts of the shaft's report.
_UNFIT = ("unreadable", "rejected_", "outliers", "older")
_INTERRUPTIONS = {
    "gaps": "pauses in the stamps",
    "jumps": "discontinuities of the angle that no shaft makes (a polled controller: see encoder_stamp_jitter_s)",
    "miscounts": "gaps of teeth or index pulses elsewhere than counted",
    "set_back": "stamps that went back",
}


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, of which kind it is, and how bad."""

    kind: str
    level: bytes
    text: str


class CountWindow:
    """Growth of counts in the last seconds.

    Args:
        window_s: how far back.
    """

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self._window_s = window_s
        self._counts: dict[str, float] = {}
        self._totals: dict[str, float] = {}
        self._past: deque[tuple[float, dict[str, float]]] = deque([(-math.inf, {})])

    def growth(self, counts: Mapping[str, float], now: float | None = None) -> dict[str, float]:
        """Take the counts of this moment; by how much each has grown since the window began.

        A count that falls has restarted at zero.
        """
        now = time.monotonic() if now is None else now
        for name, value in counts.items():
            before = self._counts.get(name, 0.0)
            self._totals[name] = self._totals.get(name, 0.0) + (value - before if value >= before else value)
        self._counts = dict(counts)
        self._past.append((now, dict(self._totals)))
        while self._past[1][0] <= now - self._window_s:
            self._past.popleft()
        first = self._past[0][1]
        return {name: self._totals[name] - first.get(name, 0.0) for name in counts}


class MeasuredTorque:
    """Size of the torque measured lately."""

    def __init__(self) -> None:
        self._latest: deque[float] = deque(maxlen=1000)

    def take(self, torques_Nm: Iterable[float]) -> None:
        """Take measured torques [N m]."""
        self._latest.extend(torques_Nm)

    def rms_Nm(self) -> float:
        """Root mean square of the latest up to 1000 that are finite; nan without any."""
        finite = [torque for torque in self._latest if math.isfinite(torque)]
        return math.sqrt(math.fsum(torque * torque for torque in finite) / len(finite)) if finite else math.nan


def sample_counts(report: SampleReport, set_back: int) -> dict[str, float]:
    """Counts of angle samples: those of the shaft's report, and how often their stamps were set back."""
    counts: dict[str, float] = {"accepted": report.accepted}
    counts |= {f"rejected_{cause}": count for cause, count in report.rejected.items()}
    names = ("repeats", "outliers", "jumps", "gaps", "reversals", "longest_gap_s")
    counts |= {name: getattr(report, name) for name in names}
    return counts | {"set_back": set_back}


def sample_findings(growth: Mapping[str, float], what: str) -> list[Finding]:
    """Faults of a stream of samples.

    Args:
        growth: counts of the last seconds: `received`; `unreadable`, `rejected_CAUSE` and `outliers`, which make its
            share of unfit samples; `gaps`, `jumps` and `set_back`.
        what: what a sample is called.
    """
    findings = []
    received = growth.get("received", 0.0)
    unfit = {name: count for name, count in growth.items() if name.startswith(_UNFIT) and count > 0}
    share = sum(unfit.values()) / received if received else 0.0
    if share > WARN_SHARE:
        causes = ", ".join(
            f"{count:.0f} {name.removeprefix('rejected_').replace('_', ' ')}" for name, count in unfit.items()
        )
        level = ERROR if share >= ERROR_SHARE else WARN
        findings.append(
            Finding("unfit", level, f"{share:.0%} of the last {received:.0f} {what} do not serve: {causes}")
        )
    findings += [
        Finding(name, WARN, f"{text}: {growth[name]:.0f} in the last {WINDOW_S:g} s")
        for name, text in _INTERRUPTIONS.items()
        if growth.get(name, 0.0) > 0
    ]
    return findings


def burst_findings(stamps_ns: IntArray, values: FloatArray, angles: bool) -> list[Finding]:
    """Detect stamps in bursts among the latest samples (n,): predictions and residuals are then wrong.

    Args:
        stamps_ns: their stamps, in the order in which they came.
        values: what was sampled.
        angles: whether the values are angles [rad].
    """
    bursts = find_bursts(stamps_ns, uneven=angles)
    if bursts is None:
        return []
    if angles:  # uneven intervals may be lost samples, and samples may be taken in bursts: the angle shows it
        found = even_times(stamps_ns, values, angles=True)
        if found is None:
            return []
    text = f"stamps in bursts: {bursts.text}; stamp samples where they are taken, the prediction is wrong with these"
    return [Finding("bursts", WARN, text)]


def joint_findings(joint: str, others: Collection[str] | None, silent_s: float) -> list[Finding]:
    """Messages come, and all of them are of other joints.

    Args:
        joint: the joint that is read.
        others: names of the joints of messages that came lately without it; None where no such message came.
        silent_s: how long no message came that has it.
    """
    if others is None or silent_s < _LATE_S:
        return []
    names = sorted(others)
    there = ", ".join(names) or "none at all"
    there = there if len(there) <= _NAMES_LENGTH else f"{there[:_NAMES_LENGTH]} ..."
    if joint in names:
        text = f"messages name joint '{joint}' and have no value of it that is read here: see which fields are filled"
    else:
        text = f"no message has joint '{joint}', there are {there}: set the parameter joint"
        text += " to the shaft's, or start its driver"
    return [Finding("joint", ERROR, text)]


def publisher_findings(publishers: Iterable[str], what: str, of_other_joints: int = 0) -> list[Finding]:
    """More than one publisher on an input makes two streams one.

    Args:
        publishers: their names.
        what: the topic.
        of_other_joints: how many of them give other joints alone.
    """
    names = sorted(publishers)
    if len(names) - of_other_joints < 2:
        return []
    return [Finding("publishers", WARN, f"{len(names)} publishers give {what}: {', '.join(names)}; stop all but one")]


def late_findings(late_s: float) -> list[Finding]:
    """Report a node this far [s] behind its input: its queues overflow before long."""
    if late_s < _LATE_S:
        return []
    text = f"this node is {late_s:.1f} s behind its input: the computer has too little CPU time for it"
    return [Finding("late", WARN, text)]


def stamp_findings(newest_ns: int | None, stamped: bool) -> list[Finding]:
    """Detect stamps of zero: an empty header, or without a header a simulated clock at standstill.

    Args:
        newest_ns: stamp of the newest sample; None without any.
        stamped: whether the messages bring it; otherwise it is the time of arrival.
    """
    if newest_ns != 0:
        return []
    if stamped:
        return [Finding("no stamp", ERROR, "the stamps are 0: the publisher does not fill in header.stamp")]
    return [Finding("no clock", ERROR, "the time is 0: use_sim_time is set, and /clock has no publisher")]


def unit_findings(angle: FloatArray, unit_rad: float) -> list[Finding]:
    """Detect another unit in the latest angles (n,), which a parameter converts by `unit_rad`."""
    seen = other_unit(angle)
    if seen is None:
        return []
    text = f"{seen.instead}: set angle_unit_rad to {unit_rad * seen.to_radians:.10g}, or correct the publisher"
    return [Finding("unit", WARN, text)]


def residual_findings(rms_Nm: float, measured_rms_Nm: float, limit_Nm: float) -> list[Finding]:
    """Detect a residual beyond its limit.

    Args:
        rms_Nm: of the latest residuals; nan without any.
        measured_rms_Nm: of the torque measured meanwhile; nan without any.
        limit_Nm: the limit; 0 where none is set: then the residual may not be larger than the measured torque itself,
            as a prediction of nothing would leave no more.
    """
    if math.isnan(rms_Nm):
        return []
    text = f"the residual, {rms_Nm:.3g} N m rms, is"
    if limit_Nm > 0.0:
        over, text = rms_Nm > limit_Nm, f"{text} over its limit of {limit_Nm:g} N m"
    else:
        over = rms_Nm > measured_rms_Nm > 0.0
        text = f"{text} larger than the measured torque, {measured_rms_Nm:.3g} N m rms: textile-twin compare says why"
    return [Finding("residual", WARN, text)] if over else []


def apart_text(apart_s: float) -> str:
    """Advice where the torque's stamps are `apart_s` from the angle's; empty where they are near, or it is nan."""
    if not abs(apart_s) > _APART_S:
        return ""
    side = "ahead of" if apart_s > 0.0 else "behind"
    return f"the torque's stamps are {abs(apart_s):.1f} s {side} the angle's; set both clocks alike"


def stalled_findings(growth: Mapping[str, float], apart_s: float) -> list[Finding]:
    """Measured torques come, and none of them gets a residual.

    Args:
        growth: counts of the last seconds: `given`, and those skipped by cause.
        apart_s: how far the torque's stamps are ahead of the angle's; nan where one of them does not come.
    """
    causes = ", ".join(f"{count:.0f} {cause}" for cause, count in growth.items() if cause != "given" and count > 0)
    reasons = [reason for reason in (apart_text(apart_s), causes) if reason]
    if growth["given"] or not reasons:
        return []
    return [Finding("stalled", WARN, f"no residual in the last {WINDOW_S:g} s: {'; '.join(reasons)}")]


def state_level(state: str) -> bytes:
    """The level of the estimator's state; the words are those of the shaft's report."""
    level: bytes = _STATE_LEVELS.get(state, OK)
    return level


def with_findings(status: Status, findings: Iterable[Finding]) -> Status:
    """The status with the worst of its own level and the findings', and all of their texts; the log has them too."""
    found = list(findings)
    if not found:
        return status
    level: bytes = max(status.level, *(finding.level for finding in found))
    text = "; ".join([*(finding.text for finding in found), status.message])
    return Status(status.name, level, text, status.values, {finding.kind: finding.text for finding in found})


_TURNS = 5.0
"""Turns that may pass without torque before a level reports them: the torque of some arrives late."""


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
