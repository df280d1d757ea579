"""Shows a running machine: serves what the nodes publish to rerun viewers, which may come and go, and to a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from rclpy.node import Node
from rclpy.task import Future

from textile_twin_core.arrays import FloatArray, IntArray
from textile_twin_ros.diagnostics import ERROR, OK, WARN, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import depth_for
from textile_twin_ros.machine import load_linkage
from textile_twin_ros.messages import SECOND_NS
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.sample_inputs import ANGLE_READERS, TORQUE_READERS, Kind, Sample, SampleInput
from textile_twin_ros.spinning import EXECUTORS, call_every, run

_HAND_OVER_S = 0.05


@dataclass
class ViewParameters:
    """Parameters of view_node."""

    machine: str = parameter("tufting", "machine name, or path of a machine file: the same as the twin's")
    host: str = parameter("127.0.0.1", "address to serve viewers on; 0.0.0.0 lets other computers look, too")
    port: int = parameter(
        9876, "port to serve viewers on, or the next one that is free; 0 serves none", between=(0, 65535)
    )
    file: str = parameter("", "also write an .rrd file")
    memory_limit: str = parameter("64MB", "how much is kept for viewers that come later")
    limit_Nm: float = parameter(0.0, "residual that is marked, in N m; 0 marks none", between=(0.0, 1e9))
    frames_hz: float = parameter(60.0, "pictures of the linkage a second at most", between=(0.1, 1000.0))
    rate_hz: float = parameter(1000.0, "samples a second at most: queues hold five seconds of them", between=(1.0, 1e5))
    qos_reliability: str = parameter(
        "auto", "of the inputs; auto goes by the publishers", choices=("auto", "reliable", "best_effort")
    )
    no_data_timeout_s: float = parameter(2.0, "say so when an input is silent so long", between=(0.1, 1e6), live=True)
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class ViewNode(Node):
    """Collects samples of the twin's topics and hands them in blocks to a live view, which draws in its own thread."""

    def __init__(self) -> None:
        # Optional packages are imported where they are used, so that a missing one is told in one line.
        from textile_twin_core.views import LiveView

        super().__init__("view_node")
        self.settings = settings = declare(self, ViewParameters)
        self.executor_name = settings.executor
        self.finished = Future()
        self._view = LiveView(
            load_linkage(settings.machine),
            host=settings.host,
            port=settings.port or None,
            path=settings.file or None,
            memory_limit=settings.memory_limit,
            limit_Nm=settings.limit_Nm or None,
            frames_hz=settings.frames_hz,
        )
        wrench, joints = TORQUE_READERS["wrench"], ANGLE_READERS["joint_state"]
        self._samples: dict[str, list[Sample]] = {}
        self._shift_ns = 0
        self._inputs = [
            self._listen("balancing_torque/predicted", wrench),
            self._listen("balancing_torque/predicted_sigma", wrench),
            self._listen("balancing_torque/measured", wrench),
            self._listen("balancing_torque/residual", wrench),
            self._listen("joint_states", joints),
        ]
        call_every(self, _HAND_OVER_S, self._hand_over)
        self._diagnostics = DiagnosticsPublisher(self, lambda: settings.machine, self._statuses)
        shown = [f"rerun {self._view.url}"] if self._view.url else []
        self.get_logger().info(f"look at it with: {' or '.join(shown + ([settings.file] if settings.file else []))}")

    def close(self) -> None:
        """Draw what is left and complete the file."""
        self._hand_over()
        self._view.close()

    def _listen(self, topic: str, kind: Kind) -> SampleInput:
        samples = self._samples[topic] = []
        settings = self.settings
        return SampleInput(
            self,
            topic,
            kind,
            "main_shaft",
            depth_for(settings.rate_hz),
            settings.qos_reliability,
            lambda: settings.no_data_timeout_s,
            samples.extend,
        )

    def _hand_over(self) -> None:
        for source in self._inputs:
            source.renew()
        self._follow_restart()
        self._hand_over_predictions()
        for name, add in (("measured", self._view.add_measured), ("residual", self._view.add_residual)):
            samples = self._samples[f"balancing_torque/{name}"]
            if samples:
                stamps, values = _columns(samples)
                add(stamps + self._shift_ns, values)
                samples.clear()
        if self._view.error is not None and not self.finished.done():
            self.get_logger().error(f"the view has ended: {self._view.error}")
            self.finished.set_result(1)

    def _follow_restart(self) -> None:
        """Where a recording is played once more, the view's time goes on: what comes now is shown a second later."""
        stamps = [sample[0] for sample in self._samples["joint_states"]]
        if not stamps or stamps[-1] > max(stamps) - SECOND_NS:
            return
        self._shift_ns += max(stamps) - stamps[-1] + SECOND_NS
        between = (max(stamps) + stamps[-1]) // 2
        for samples in self._samples.values():
            samples[:] = [sample for sample in samples if sample[0] < between]

    def _hand_over_predictions(self) -> None:
        """Predictions go with the shaft's angle, which joint_states tells for the same stamps or, thinned, for some."""
        predicted = self._samples["balancing_torque/predicted"]
        sigmas = self._samples["balancing_torque/predicted_sigma"]
        joints = self._samples["joint_states"]
        if not predicted or not joints:
            return
        joint_stamps, theta = _columns(joints)
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

    def _statuses(self) -> list[Status]:
        inputs = [source.status() for source in self._inputs]
        if self._view.error is not None:
            return [*inputs, Status("view", ERROR, str(self._view.error))]
        dropped = self._view.dropped
        text = f"serving {self._view.url or 'nobody'}"
        return [*inputs, Status("view", WARN if dropped else OK, text, {"samples_not_drawn": dropped})]


def _columns(samples: list[Sample]) -> tuple[IntArray, FloatArray]:
    """Stamps [ns] and values of samples, sorted by stamp."""
    stamps = np.array([sample[0] for sample in samples], dtype=np.int64)
    values = np.array([sample[1] for sample in samples])
    order = np.argsort(stamps, kind="stable")
    return stamps[order], values[order]


def _drop_before(samples: list[Sample], stamp_ns: int) -> None:
    """Forget what is older than a stamp, but for the newest of it: the next interval begins there."""
    older = sum(sample[0] < stamp_ns for sample in samples)
    del samples[: max(older - 1, 0)]


def main(arguments: list[str] | None = None) -> int:
    """Run view_node."""
    return run("view_node", ViewNode, ViewParameters, arguments)
