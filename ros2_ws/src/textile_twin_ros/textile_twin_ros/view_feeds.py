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

"""Input of a view: the twin's topics in blocks, for a linkage and for a machine of sliding elements."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Protocol

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_core.twin.predictor import StampedEvent
from textile_twin_ros.contact_events import contact_events
from textile_twin_ros.inputs import Sample, SampleInput
from textile_twin_ros.messages import (
    ANGLE_READERS,
    SECOND_NS,
    TORQUE_READERS,
    Kind,
    MessageError,
    PositionsReader,
    stamp_of,
)

if TYPE_CHECKING:
    from textile_twin_core.views import LiveElements, LiveView

Listen = Callable[[str, Kind, str, Callable[[list[Sample]], None]], SampleInput]
"""Opens an input: topic, kind, joint, taker of its samples."""


_MOST_WAITING = 50_000
"""Samples of a topic or an element that wait for the others' at most."""


class Feed(Protocol):
    """Inputs that gather samples for the view."""

    inputs: list[SampleInput]

    def expected(self) -> list[SampleInput]:
        """Those whose silence is worth a word."""

    def hand_over(self) -> None:
        """Give the view the samples since the last call."""


class LinkageFeed:
    """Predicted and measured torque, residual and shaft angle of a linkage.

    Args:
        view: what is fed.
        listen: opens an input.
        stations: names of the stations of an elastic shaft, whose joint states come to `hear_stations`.
        frames_hz: the most pictures a second.
    """

    def __init__(self, view: LiveView, listen: Listen, stations: Sequence[str] = (), frames_hz: float = 60.0) -> None:
        self._view = view
        self._reader = PositionsReader([f"station_{name}" for name in stations])
        self._period_ns, self._next_ns = round(SECOND_NS / frames_hz), 0
        self._turned: list[tuple[int, list[float]]] = []
        self._samples: dict[str, list[Sample]] = {}
        self._shift_ns = 0
        wrench, joints = TORQUE_READERS["wrench"], ANGLE_READERS["joint_state"]
        names = ("predicted", "predicted_sigma", "measured", "residual") if view.has_complete_torque else ()
        kinds = {f"balancing_torque/{name}": wrench for name in names} | {"joint_states": joints}
        self._inputs: dict[str, SampleInput] = {}
        for topic, kind in kinds.items():
            self._samples[topic] = []
            self._inputs[topic] = listen(topic, kind, "main_shaft", self._samples[topic].extend)
        self.inputs = list(self._inputs.values())

    def expected(self) -> list[SampleInput]:
        """Expected topics; measured torque and residual only with a torque sensor."""
        measured = self._inputs.get("balancing_torque/measured")
        if measured is None or measured.watch.received or measured.has_publishers():
            return self.inputs
        return [source for source in self.inputs if not source.name.endswith(("/measured", "/residual"))]

    def hear_stations(self, raw: bytes) -> None:
        """Take the angles of all stations from a message of joint_states, as often as pictures are drawn."""
        with suppress(MessageError):  # of other joints: the input of the same topic reports it
            stamp = stamp_of(raw)
            if stamp >= self._next_ns or stamp < self._next_ns - SECOND_NS:
                self._turned.append(self._reader.positions(raw))
                self._next_ns = stamp + self._period_ns
                del self._turned[:-_MOST_WAITING]

    def hand_over(self) -> None:
        """Give the view the samples since the last call."""
        self._follow_restart()
        if self._turned:
            turned_ns = np.array([stamp for stamp, _ in self._turned], dtype=np.int64)
            self._view.add_stations(turned_ns + self._shift_ns, np.array([angles for _, angles in self._turned]))
            self._turned.clear()
        self._hand_over_predictions()
        for name, add in (("measured", self._view.add_measured), ("residual", self._view.add_residual)):
            samples = self._samples.get(f"balancing_torque/{name}")
            if samples:
                stamps, values = _columns(samples)
                add(stamps + self._shift_ns, values)
                samples.clear()
        for samples in self._samples.values():  # predictions without joint states would wait for ever
            del samples[:-_MOST_WAITING]

    def _follow_restart(self) -> None:
        """Continue the view's time a second later where a recording is played once more."""
        stamps = [sample[0] for sample in self._samples["joint_states"]]
        if not stamps or stamps[-1] > max(stamps) - SECOND_NS:
            return
        self._shift_ns += max(stamps) - stamps[-1] + SECOND_NS
        between = (max(stamps) + stamps[-1]) // 2
        for samples in self._samples.values():
            samples[:] = [sample for sample in samples if sample[0] < between]

    def _hand_over_predictions(self) -> None:
        """Pair predictions with the shaft's angle, which joint_states has for the same stamps or, thinned, for some."""
        joints = self._samples["joint_states"]
        if not joints:
            return
        joint_stamps, theta = _columns(joints)
        if not self._view.has_complete_torque:
            self._view.add_motion(joint_stamps + self._shift_ns, theta)
            joints.clear()
            return
        predicted = self._samples["balancing_torque/predicted"]
        sigmas = self._samples["balancing_torque/predicted_sigma"]
        if not predicted:
            return
        stamps, torque = _columns(predicted)
        count = int(np.searchsorted(stamps, joint_stamps[-1], side="right"))
        if not count:
            return
        stamps, torque = stamps[:count], torque[:count]
        theta = np.interp(stamps - joint_stamps[0], joint_stamps - joint_stamps[0], theta)
        sigma = np.full(count, np.nan)
        if sigmas:
            sigma_stamps, values = _columns(sigmas)
            place = np.searchsorted(sigma_stamps, stamps).clip(max=len(sigma_stamps) - 1)
            sigma = np.where(sigma_stamps[place] == stamps, values[place], np.nan)
        self._view.add_predicted(stamps + self._shift_ns, theta, torque, sigma)
        del predicted[:count]
        _drop_before(sigmas, int(stamps[-1]))
        _drop_before(joints, int(stamps[-1]))


class ElementFeed:
    """Positions and velocities of a machine's elements, which are the joints of its joint states, and their impacts.

    Args:
        view: what is fed.
        elements: their names, in the view's order.
        listen: opens an input.
    """

    def __init__(self, view: LiveElements, elements: tuple[str, ...], listen: Listen) -> None:
        self._view = view
        self._samples: list[list[Sample]] = [[] for _ in elements]
        self._newest_ns, self._shift_ns = 0, 0
        self.inputs = [
            listen("joint_states", ANGLE_READERS["joint_state"], element, samples.extend)
            for element, samples in zip(elements, self._samples, strict=True)
        ]

    def expected(self) -> list[SampleInput]:
        """All of them."""
        return self.inputs

    def hear(self, message: DiagnosticArray) -> None:
        """Take contact events."""
        events = contact_events(message)
        self._view.add_events([StampedEvent(stamp + self._shift_ns, event) for stamp, event in events])

    def hand_over(self) -> None:
        """Give the view the messages that all elements have been read from.

        Each element has a subscription of its own: the first to hear hears messages that the others do not.
        """
        common = set.intersection(*({sample[0] for sample in samples} for samples in self._samples))
        rows = [[sample for sample in samples if sample[0] in common] for samples in self._samples]
        count = min(map(len, rows))
        if not count:
            for samples in self._samples:
                del samples[:-_MOST_WAITING]
            return
        stamps = np.array([sample[0] for sample in rows[0][:count]], dtype=np.int64)
        if stamps[0] < self._newest_ns - SECOND_NS:  # played once more: the view's time goes on
            self._shift_ns += self._newest_ns - int(stamps[0]) + SECOND_NS
        self._newest_ns = int(stamps[-1])
        values = np.array([[sample[1:] for sample in samples[:count]] for samples in rows])
        self._view.add_motion(stamps + self._shift_ns, values[:, :, 0].T, values[:, :, 1].T)
        for samples, row in zip(self._samples, rows, strict=True):
            del samples[: samples.index(row[count - 1]) + 1]


def _columns(samples: list[Sample]) -> tuple[IntArray, FloatArray]:
    """Stamps [ns] and values of samples, sorted by stamp."""
    stamps = np.array([sample[0] for sample in samples], dtype=np.int64)
    values = np.array([sample[1] for sample in samples])
    order = np.argsort(stamps, kind="stable")
    return stamps[order], values[order]


def _drop_before(samples: list[Sample], stamp_ns: int) -> None:
    """Drop samples older than a stamp, except the newest of them: the next interval begins there."""
    older = sum(sample[0] < stamp_ns for sample in samples)
    del samples[: max(older - 1, 0)]
