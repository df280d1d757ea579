"""A recording through the twin into a new recording, which ends by itself when all has been played.

ros2 launch textile_twin_ros replay.launch.py bag:=bags/tufting_160rpm_synthetic out:=out/recording rate:=4.0
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, RegisterEventHandler, Shutdown
from launch.event_handlers import OnProcessExit
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

INPUTS = ["main_shaft/angle", "balancing_torque/measured"]
OUTPUTS = [
    "balancing_torque/predicted",
    "balancing_torque/predicted_sigma",
    "balancing_torque/residual",
    "needle/position",
    "joint_states",
]
# Queues hold some minutes of 500 Hz: a busy computer then delays but loses nothing.
DEPTH = 100_000


def generate_launch_description() -> LaunchDescription:
    recorder = Node(
        package="textile_twin_ros",
        executable="record_node",
        parameters=[
            {
                "bag": LaunchConfiguration("out"),
                "topics": INPUTS + OUTPUTS,
                "stop_when_idle_s": 2.0,
                "rate_hz": float(DEPTH),
                "queue_s": 1.0,
            }
        ],
        output="screen",
    )
    twin = Node(
        package="textile_twin_ros",
        executable="twin_node",
        parameters=[{"machine": LaunchConfiguration("machine"), "wait_for": OUTPUTS, "qos_depth": DEPTH}],
        output="screen",
    )
    replay = Node(
        package="textile_twin_ros",
        executable="replay_node",
        parameters=[
            {
                "bag": LaunchConfiguration("bag"),
                "rate": ParameterValue(LaunchConfiguration("rate"), value_type=float),
                "wait_for": [f"{topic}=2" for topic in INPUTS],
                "qos_depth": DEPTH,
            }
        ],
        output="screen",
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="the recording to play"),
            DeclareLaunchArgument("out", default_value="out/recording", description="the recording to write"),
            DeclareLaunchArgument("machine", default_value="tufting", description="machine name or machine file"),
            DeclareLaunchArgument("rate", default_value="1.0", description="speed of playing"),
            recorder,
            twin,
            replay,
            RegisterEventHandler(OnProcessExit(target_action=recorder, on_exit=[Shutdown(reason="recorded")])),
        ]
    )
