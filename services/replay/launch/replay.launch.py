"""Start replay; `params_file:=` names its YAML file."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    default = PathJoinSubstitution([FindPackageShare("replay"), "config", "default.yaml"])
    return LaunchDescription(
        [
            SetEnvironmentVariable("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4"),
            DeclareLaunchArgument("params_file", default_value=default),
            Node(
                package="replay",
                executable="replay",
                parameters=[LaunchConfiguration("params_file")],
            ),
        ]
    )
