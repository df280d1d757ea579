"""A mill: one twin for each machine, in a namespace of its own, with parameters from one file.

ros2 launch textile_twin_ros mill.launch.py machines:="m1 m2 m3" params_file:=mill.yaml
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def twins(context: LaunchContext) -> list[Node]:
    """The nodes of all machines named."""
    mill, machines = (LaunchConfiguration(name).perform(context) for name in ("mill", "machines"))
    return [
        Node(
            package="textile_twin_ros",
            executable="twin_node",
            namespace=f"/{mill}/{machine}",
            parameters=[LaunchConfiguration("params_file")],
            output="screen",
        )
        for machine in machines.split()
    ]


def generate_launch_description() -> LaunchDescription:
    config = PathJoinSubstitution([FindPackageShare("textile_twin_ros"), "config", "mill.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("mill", default_value="mill", description="namespace of the mill"),
            DeclareLaunchArgument("machines", default_value="m1 m2", description="namespaces of its machines"),
            DeclareLaunchArgument("params_file", default_value=config, description="parameters of the twins"),
            OpaqueFunction(function=twins),
        ]
    )
