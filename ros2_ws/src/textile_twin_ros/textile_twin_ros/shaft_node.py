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

"""A simulated machine: an encoder and a torque sensor on a shaft, for trying the suite without a machine."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

import textile_twin_core as ttc
from textile_twin_core.arrays import FloatArray
from textile_twin_core.twin.encoder_reference import check_reference
from textile_twin_ros.endpoints import depth_for, samples_qos
from textile_twin_ros.machine import load_machine
from textile_twin_ros.messages import SECOND_NS, HeaderTemplate, JointTemplate, WrenchTemplate
from textile_twin_ros.node_runner import EXECUTORS, finish_with, run
from textile_twin_ros.outputs import TORQUE
from textile_twin_ros.pacing import Pace
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.publishing import Publish, create_publish
from textile_twin_ros.sensor_parameters import EncoderParameters
from textile_twin_ros.shaft_motion import TURN, Marks, SimulatedEncoder, SimulatedShaft, SimulatedTorqueSensor

_LOOK_S = 0.05


@dataclass
class ShaftParameters(EncoderParameters):
    """Parameters of shaft_node."""

    angle_type: str = parameter(
        "joint_state",
        "what the encoder sends: its angle, or edges: a std_msgs/Header for each tooth",
        choices=("joint_state", "edges"),
    )
    index: bool = parameter(
        False, "an index pulse for each turn on main_shaft/index; angles then count from where it was switched on"
    )
    rate_hz: float = parameter(500.0, "samples a second", between=(1.0, 2e4))
    rpm: float = parameter(
        0.0, "speed after the run-up; negative runs backwards; 0 is the machine's nominal speed", between=(-1e4, 1e4)
    )
    run_up_s: float = parameter(3.0, "seconds from standstill to that speed", between=(0.0, 1e4))
    ripple: float = parameter(0.02, "relative ripple of the speed, once a turn", between=(0.0, 0.9))
    encoder_bits: int = parameter(16, "resolution of the encoder; 0 is exact", between=(0, 30))
    torque_noise_Nm: float = parameter(0.05, "standard deviation of the torque sensor's noise", between=(0.0, 1e6))
    seed: int = parameter(0, "of the noise", between=(0, 2**31))
    duration_s: float = parameter(0.0, "end after this time; 0 is never", between=(0.0, 1e9))
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class ShaftNode(Node):
    """Publishes readings of the machine's sensor model, timed by a thread of its own."""

    def __init__(self) -> None:
        super().__init__("shaft_node")
        self.settings = parameters = declare(self, ShaftParameters)
        self.executor_name = parameters.executor
        self.finished = Future()
        machine = load_machine(parameters.machine, parameters.encoder())
        self._twin = ttc.compile(machine, outputs=[TORQUE]) if machine.has_complete_torque else None
        encoder, torque = machine.sensors.encoder, machine.sensors.torque
        self._rpm = parameters.rpm or machine.nominal_speed_rad_s * 60.0 / TURN
        self._motion = SimulatedShaft(self._rpm, parameters.run_up_s, parameters.ripple)
        self._encoder = SimulatedEncoder(parameters.encoder_bits, encoder)
        self._sensor = SimulatedTorqueSensor(torque, self._torques, parameters.torque_noise_Nm, parameters.seed)
        self._delay_s = torque.delay_s
        self._torque = WrenchTemplate("main_shaft")
        qos = samples_qos(depth_for(parameters.rate_hz))
        self._publish_angle = self._create_angle(encoder, qos)
        self._send_torque: Publish | None = None
        if self._twin is not None:
            self._send_torque = create_publish(self, WrenchStamped, "balancing_torque/measured", qos)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=finish_with, args=(self.finished, self._work), name="shaft")
        self._thread.start()

    def _create_angle(self, encoder: ttc.machines.Encoder, qos: QoSProfile) -> Callable[[int, float, float], None]:
        """Publisher of the angle, or of edges and index since the sample before, for (start [ns], time, before).

        Raises:
            SceneError: edges of a wheel that has no teeth, or whose tooth 0 is not marked.
        """
        edges, index = self.settings.angle_type == "edges", self.settings.index
        check_reference(encoder, edges, index)
        motion, wheel = self._motion, self._encoder
        marks: list[tuple[Publish, Marks]] = []
        pitch = TURN / encoder.teeth if encoder.teeth else 0.0
        if edges:
            teeth = [k * pitch for k in range(encoder.teeth - encoder.missing_teeth)]
            marks.append(
                (
                    create_publish(self, Header, "main_shaft/angle", qos),
                    Marks(teeth, motion, wheel),
                )
            )
        if index:
            place = [TURN - 0.5 * pitch] if edges else [0.0]  # before tooth 0
            marks.append(
                (
                    create_publish(self, Header, "main_shaft/index", qos),
                    Marks(place, motion, wheel),
                )
            )
        event, angle = HeaderTemplate("main_shaft"), JointTemplate(["main_shaft"], velocities=False)
        send_angle = None if edges else create_publish(self, JointState, "main_shaft/angle", qos)
        switched_on = wheel.turned(0.0) if index else 0.0

        def publish(start_ns: int, time_s: float, before_s: float) -> None:
            if send_angle is not None:
                shown = (wheel.read(motion.at(time_s)[0]) - switched_on) % TURN
                send_angle(angle.message(start_ns + round(time_s * SECOND_NS), shown))
            for send, passing in marks:
                for passed_s in passing.passed(before_s, time_s):
                    send(event.message(start_ns + round(passed_s * SECOND_NS)))

        return publish

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _work(self) -> int:
        parameters = self.settings
        start_ns = self._begun_ns()
        if not start_ns:
            return 0
        pace = Pace(self._stop)
        number = 0
        self.get_logger().info(f"{parameters.machine} at {self._rpm:g} rpm, {parameters.rate_hz:g} samples a second")
        while pace.wait_until(number / parameters.rate_hz):
            time_s = number / parameters.rate_hz
            if parameters.duration_s and time_s > parameters.duration_s:
                return 0
            self._publish_angle(start_ns, time_s, max(number - 1, 0) / parameters.rate_hz)
            self._publish_torque(start_ns + round(time_s * SECOND_NS), time_s)
            number += 1
        return 0

    def _begun_ns(self) -> int:
        """Now, which where it is a simulation's time is there from the first /clock on; 0 when stopped."""
        warned = False
        while not (now_ns := self.get_clock().now().nanoseconds) and not self._stop.wait(_LOOK_S):
            if not warned:
                self.get_logger().warning("waits for a first /clock: use_sim_time is set, and no time has come")
            warned = True
        return now_ns

    def _publish_torque(self, stamp_ns: int, time_s: float) -> None:
        if self._twin is not None and self._send_torque is not None and time_s >= self._delay_s:
            self._send_torque(self._torque.message(stamp_ns, float(self._sensor.read(time_s))))

    def _torques(self, times_s: FloatArray) -> FloatArray:
        """True torques at times (n,) [s]."""
        assert self._twin is not None
        if times_s.size == 1:
            return np.array((self._twin.evaluate(*self._motion.at(float(times_s[0])))[TORQUE],), np.float64)
        theta, omega, alpha = np.array([self._motion.at(time) for time in times_s.tolist()]).T
        return np.asarray(self._twin.evaluate(theta, omega, alpha)[TORQUE])


def main(arguments: list[str] | None = None) -> int:
    """Run shaft_node."""
    return run("shaft_node", ShaftNode, ShaftParameters, arguments)
