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

"""The digital twin: from each sample of the shaft angle to torque, joints and tool, with that sample's stamp."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.task import Future
from std_srvs.srv import Trigger

from textile_twin_core.errors import SceneError, TwinError
from textile_twin_core.machine import AnyMachine
from textile_twin_core.twin.encoder_reference import check_reference
from textile_twin_core.twin.session import has_second_encoder
from textile_twin_ros.description import Description
from textile_twin_ros.diagnostics import OK, WARN, DiagnosticsPublisher, Status
from textile_twin_ros.endpoints import QUEUE_S, depth_for, publisher_name, refuse_own_outputs
from textile_twin_ros.health import Finding, MeasuredTorque, with_findings
from textile_twin_ros.inputs import AngleInput, Sample, SecondAngleInput, TorqueInput
from textile_twin_ros.machine import load_machine
from textile_twin_ros.machine_namespace import DESCRIPTIONS, INDEX, INPUTS, SECOND_ANGLE
from textile_twin_ros.node_runner import EXECUTORS, call_every, ends_at_once, is_refusal, run
from textile_twin_ros.outputs import TwinStream, topics_of
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.publishing import RCLError
from textile_twin_ros.sensor_parameters import SensorParameters

_LOOK_S = 0.1
_ENDED_S = 0.5
_SUCCESS, _FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


@dataclass
class TwinParameters(SensorParameters):
    """Parameters of twin_node."""

    shaft: str = parameter("causal", "estimator of the shaft's state", choices=("causal", "lag"))
    shaft_lag_s: float = parameter(0.04, "with shaft lag: how long it looks ahead", between=(0.001, 1.0))
    qos_depth: int = parameter(0, "depth of the queues; 0 holds five seconds at rate_hz", between=(0, 10_000_000))
    joint_states_rate_hz: float = parameter(
        0.0, "largest rate of joint_states; 0 is every sample", between=(0.0, 1e5), live=True
    )
    residual_limit_Nm: float = parameter(
        0.0,
        "rms of the residual, in N m, above which the diagnostics warn; 0: where it is larger than the measured torque",
        between=(0.0, 1e9),
        live=True,
    )
    autostart: bool = parameter(True, "configure and activate at the start; otherwise by lifecycle services")
    wait_for: tuple[str, ...] = parameter(
        (), "outputs that need a subscriber before autostart activates, such as balancing_torque/predicted"
    )
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


Transition = Callable[["TwinNode", LifecycleState], TransitionCallbackReturn]


def ends_on_error(transition: Transition) -> Transition:
    """The same transition; an error in it, which rclpy would hold back without a word, ends the node."""

    @wraps(transition)
    def watched(node: TwinNode, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            return transition(node, state)
        except Exception as error:  # reported by the runner of the node
            if not node.finished.done():
                node.finished.set_exception(SceneError(str(error)) if is_refusal(error) else error)
            raise

    return watched


class TwinNode(LifecycleNode):
    """Lifecycle node around one TwinStream.

    unconfigured: knows nothing. inactive: machine compiled, robot_description out, topics there, samples ignored.
    active: samples in, predictions out.
    """

    def __init__(self) -> None:
        super().__init__("twin_node")
        self.settings = declare(self, TwinParameters)
        self.executor_name = self.settings.executor
        self.finished = Future()
        self._stream: TwinStream | None = None
        self._machine: AnyMachine | None = None
        self._angle: AngleInput | None = None
        self._torque: TorqueInput | None = None
        self._second: SecondAngleInput | None = None
        self._description: Description | None = None
        self._measured = MeasuredTorque()
        self._active = False
        self._dropped = 0
        self._starting = self.settings.autostart
        self._refuse_what_does_not_fit()
        self.create_service(Trigger, "~/reset", self._on_reset)
        self._diagnostics = DiagnosticsPublisher(self, lambda: self.settings.machine, self._statuses)
        if self._starting and self.trigger_configure() is not _SUCCESS:
            self.finished.result()  # raises what was wrong
        call_every(self, _LOOK_S, self._look)

    def _refuse_what_does_not_fit(self) -> None:
        """Answer a transition that this state does not have with false.

        The service of rclpy raises there, which ends the node (ros2/rclpy#1209), and its handler is private: it is
        wrapped by public attributes, `Node.services` and `Service.callback`, until all supported distributions have
        ros2/rclpy#1319.
        """
        service = next(service for service in self.services if service.srv_type is ChangeState)
        change = service.callback

        def answer(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
            try:
                return change(request, response)
            except RCLError:  # which the middleware has logged
                response.success = False
                return response

        service.callback = answer

    def close(self) -> None:
        """Do nothing: the middleware has all published messages."""

    @ends_on_error
    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Compile the machine and create the topics."""
        settings = self.settings
        try:
            machine = self._machine = load_machine(settings.machine, settings.encoder())
            check_reference(machine.sensors.encoder, settings.angle_type == "edges", settings.index)
            outputs = topics_of(machine)
            unknown = [topic for topic in settings.wait_for if topic not in outputs]
            if unknown:
                raise TwinError(f"parameter 'wait_for': no output '{unknown[0]}'; available: {', '.join(outputs)}")
            used = {INDEX: settings.index, SECOND_ANGLE: has_second_encoder(machine)}
            inputs = tuple(name for name in INPUTS if used.get(name, True))
            refuse_own_outputs(self, inputs, (*outputs, *DESCRIPTIONS, "/diagnostics"))
            depth = settings.qos_depth or depth_for(settings.rate_hz)
            estimator = {"shaft_lag_s": settings.shaft_lag_s} if settings.shaft == "lag" else {}
            with ends_at_once():  # it may compile for a minute
                self._stream = TwinStream(
                    self,
                    machine,
                    settings.shaft,
                    estimator,
                    depth,
                    lambda: settings.joint_states_rate_hz,
                    self._choose_outputs,
                )
        except TwinError as error:
            if self._starting:
                raise
            self.get_logger().error(str(error))
            return _FAILURE
        self._description = Description(self, machine)
        return super().on_configure(state)

    @ends_on_error
    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Listen."""
        settings, stream = self.settings, self._stream
        assert stream is not None and self._machine is not None
        self._starting = False  # however it came to this
        stream.reset()
        self._measured = MeasuredTorque()
        depth = settings.qos_depth or depth_for(settings.rate_hz)
        self._angle = AngleInput(self, settings, self._machine, depth, stream.take_angles)
        self._torque = TorqueInput(self, settings, depth, self._on_torques)
        if has_second_encoder(self._machine):
            self._second = SecondAngleInput(self, settings, depth, stream.take_second_angles)
        self._active = True
        result = super().on_activate(state)
        self.get_logger().info(f"{settings.machine}: predicting from {self._angle.name}, estimator {settings.shaft}")
        return result

    @ends_on_error
    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the estimator's last samples, and stop listening."""
        if self._stream is not None:
            self._stream.flush()
        self._stop_listening()
        return super().on_deactivate(state)

    @ends_on_error
    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget the machine and remove the topics."""
        self._starting = False
        self._stop_listening()
        if self._stream is not None:
            self._stream.destroy()
            if self._description is not None:
                self._description.destroy()
                self._description = None
            self._stream = None
        return super().on_cleanup(state)

    @ends_on_error
    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Publish the estimator's last samples, and end the node."""
        if self._stream is not None and self._active:
            self._stream.flush()
        self._stop_listening()
        self.finished.set_result(0)
        return super().on_shutdown(state)

    def _stop_listening(self) -> None:
        self._active = False
        for source in (self._angle, self._torque, self._second):
            if source is not None:
                source.destroy()
        self._angle = self._torque = self._second = None

    def _on_torques(self, block: list[Sample]) -> None:
        if self._stream is not None and self._active:
            self._measured.take(torque for _, torque, _ in block)
            self._stream.take_torques([(stamp, torque) for stamp, torque, _ in block])

    def _look(self) -> None:
        """Check start, torque and the end of the input between samples."""
        stream = self._stream
        if stream is None:
            return
        dropped = stream.retry()
        if dropped > self._dropped:
            self.get_logger().error(
                f"{dropped - self._dropped} messages dropped: the middleware has not taken them for"
                f" {QUEUE_S:g} s; the computer has too little processor time, or a subscriber hangs",
                throttle_duration_sec=10.0,
            )
        self._dropped = dropped
        self._choose_outputs()
        if self._starting and all(stream.subscribers[topic] for topic in self.settings.wait_for):
            self.trigger_activate()
        if self._active and self._angle is not None and self._torque is not None:
            self._angle.renew()
            self._torque.renew()
            if self._second is not None:
                self._second.renew()
            # A flush ends the estimator's record, which a mere pause must not do.
            ended = self._angle.watch.received and self._angle.watch.silent_s > _ENDED_S
            if self.settings.shaft == "lag" and ended and not self._angle.has_publishers():
                stream.flush()

    def _choose_outputs(self) -> None:
        """Compute what has subscribers now, and residuals where torque is measured."""
        if self._stream is not None:
            torque = self._torque
            measured = torque is not None and (torque.watch.received > 0 or torque.has_publishers())
            self._stream.choose_outputs(measured)

    def _statuses(self) -> list[Status]:
        stream, angle, torque = self._stream, self._angle, self._torque
        if stream is None or angle is None or torque is None:
            text = "waiting for subscribers" if self._starting else "not active: activate it by its lifecycle services"
            return [Status("twin", WARN, text)]
        report = stream.report
        statuses = [*angle.statuses(stream.sample_counts(report)), stream.estimator_status(self.settings.shaft, report)]
        if self._second is not None:
            statuses.append(self._second.status())
        if torque.watch.received or torque.has_publishers():
            statuses.append(torque.status())
            both_come = max(angle.watch.silent_s, torque.watch.silent_s) < _ENDED_S
            limit_Nm = self.settings.residual_limit_Nm
            statuses.append(stream.residual_status(self._measured.rms_Nm(), limit_Nm, both_come))
        outputs = ", ".join(stream.wanted_topics()) or "nothing: no topic has a subscriber"
        status = Status("outputs", OK, f"computing {outputs}")
        return [*statuses, with_findings(status, self._rivals())]

    def _rivals(self) -> list[Finding]:
        """Another twin on the same topics: listeners then hear both machines at once."""
        assert self._stream is not None
        topic = next(iter(self._stream.publishers.values())).topic_name
        names = [publisher_name(info) for info in self.get_publishers_info_by_topic(topic)]
        own = self.get_fully_qualified_name()
        if len(names) < 2:
            return []
        if own in names:
            names.remove(own)
        text = (
            f"{topic} has another publisher, {', '.join(sorted(names))}: give each machine a namespace,"
            " -r __ns:=/machine_2; if a recording is played, play its inputs alone"
        )
        return [Finding("rival", WARN, text)]

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._stream is None or self._angle is None or self._torque is None:
            response.success, response.message = False, "not active: there is nothing to reset"
            return response
        self._stream.reset()
        self._angle.restart()
        self._torque.restart()
        if self._second is not None:
            self._second.restart()
        response.success, response.message = True, "estimator, residuals and counts are reset"
        return response


def main(arguments: list[str] | None = None) -> int:
    """Run twin_node."""
    return run("twin_node", TwinNode, TwinParameters, arguments)
