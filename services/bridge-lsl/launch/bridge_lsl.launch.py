"""Start bridge-lsl; `params_file:=` names its YAML file."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "bridge_lsl"


def generate_launch_description() -> LaunchDescription:
    default = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "default.yaml"])
    return LaunchDescription(
        [
            SetEnvironmentVariable("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4"),
            DeclareLaunchArgument("params_file", default_value=default),
            Node(package=PACKAGE, executable=PACKAGE, parameters=[LaunchConfiguration("params_file")]),
        ]
    )
