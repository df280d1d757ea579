"""A simulated machine: an encoder and a torque sensor on a shaft, for trying the suite without a machine."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.task import Future
from sensor_msgs.msg import JointState

import textile_twin_core as ttc
from textile_twin_ros.endpoints import depth_for, samples_qos
from textile_twin_ros.machine import load_machine
from textile_twin_ros.messages import SECOND_NS, JointTemplate, WrenchTemplate
from textile_twin_ros.pacing import Pace
from textile_twin_ros.parameters import declare, parameter
from textile_twin_ros.shaft_motion import Encoder, ShaftMotion, TorqueSensor
from textile_twin_ros.spinning import EXECUTORS, finish_with, run
from textile_twin_ros.twin_outputs import TORQUE, has_torque


@dataclass
class ShaftParameters:
    """Parameters of shaft_node."""

    machine: str = parameter("tufting", "machine name, or path of a machine file")
    rate_hz: float = parameter(500.0, "samples a second", between=(1.0, 2e4))
    rpm: float = parameter(160.0, "speed after the run-up; negative runs backwards", between=(-1e4, 1e4))
    run_up_s: float = parameter(3.0, "seconds from standstill to that speed", between=(0.0, 1e4))
    ripple: float = parameter(0.02, "relative ripple of the speed, once a turn", between=(0.0, 0.9))
    encoder_bits: int = parameter(16, "resolution of the encoder; 0 is exact", between=(0, 30))
    torque_noise_Nm: float = parameter(0.05, "standard deviation of the torque sensor's noise", between=(0.0, 1e6))
    seed: int = parameter(0, "of the noise", between=(0, 2**31))
    duration_s: float = parameter(0.0, "end after so long; 0 is never", between=(0.0, 1e9))
    executor: str = parameter("events", "how callbacks are run", choices=EXECUTORS)


class ShaftNode(Node):
    """Publishes what the machine's sensors would, with its own sensor model; a thread of its own keeps the time."""

    def __init__(self) -> None:
        super().__init__("shaft_node")
        self.settings = parameters = declare(self, ShaftParameters)
        self.executor_name = parameters.executor
        self.finished = Future()
        machine = load_machine(parameters.machine)
        self._twin = ttc.compile(machine, outputs=[TORQUE]) if has_torque(machine) else None
        encoder, torque = machine.sensors.encoder, machine.sensors.torque
        self._motion = ShaftMotion(parameters.rpm, parameters.run_up_s, parameters.ripple)
        self._encoder = Encoder(parameters.encoder_bits, encoder.zero_rad, encoder.direction, encoder.ratio)
        self._sensor = TorqueSensor(torque.gain, torque.offset_Nm, parameters.torque_noise_Nm, parameters.seed)
        self._delay_s = torque.delay_s
        self._angle = JointTemplate(["main_shaft"], velocities=False)
        self._torque = WrenchTemplate("main_shaft")
        qos = samples_qos(depth_for(parameters.rate_hz))
        self._angles = self.create_publisher(JointState, "main_shaft/angle", qos)
        self._torques = self.create_publisher(WrenchStamped, "balancing_torque/measured", qos)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=finish_with, args=(self.finished, self._work), name="shaft")
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def _work(self) -> int:
        parameters = self.settings
        start_ns = self.get_clock().now().nanoseconds
        pace = Pace(self._stop)
        number = 0
        self.get_logger().info(
            f"{parameters.machine} at {parameters.rpm:g} rpm, {parameters.rate_hz:g} samples a second"
        )
        while pace.wait_until(number / parameters.rate_hz):
            time_s = number / parameters.rate_hz
            if parameters.duration_s and time_s > parameters.duration_s:
                return 0
            self._publish(start_ns + round(time_s * SECOND_NS), time_s)
            number += 1
        return 0

    def _publish(self, stamp_ns: int, time_s: float) -> None:
        theta, _, _ = self._motion.at(time_s)
        self._angles.publish(self._angle.message(stamp_ns, self._encoder.read(theta)))
        if self._twin is not None and time_s >= self._delay_s:
            torque = float(self._twin.evaluate(*self._motion.at(time_s - self._delay_s))[TORQUE])
            self._torques.publish(self._torque.message(stamp_ns, self._sensor.read(torque)))


def main(arguments: list[str] | None = None) -> int:
    """Run shaft_node."""
    return run("shaft_node", ShaftNode, ShaftParameters, arguments)
