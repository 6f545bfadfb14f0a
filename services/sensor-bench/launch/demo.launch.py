"""The demo graph in a ROS 2 workspace: virtual sensors and every service; `study:=` names the sensors' folder."""

from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SERVICES = (
    "clock_sync",
    "interpreter_ecg",
    "interpreter_ppg",
    "metadata_registry",
    "fusion_affect",
    "recorder",
    "web_gui",
)


def _nodes(context: LaunchContext) -> list[Node]:
    study = Path(LaunchConfiguration("study").perform(context))
    socket = LaunchConfiguration("socket").perform(context)
    bus = {"DBUS_SYSTEM_BUS_ADDRESS": f"unix:path={socket}"}
    drivers = [
        Node(package="driver_polar", executable="driver_polar", parameters=[str(sensor)], additional_env=bus)
        for sensor in sorted(study.glob("*_[0-9].yaml"))
    ]
    bench = Node(package="sensor_bench", executable="sensor_bench", parameters=[{"socket_path": socket}])
    return [bench, *(Node(package=name, executable=name) for name in SERVICES), *drivers]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription(
        [
            SetEnvironmentVariable("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4"),
            DeclareLaunchArgument("study", description="folder with one YAML file per sensor (compose/studies/demo)"),
            DeclareLaunchArgument("socket", default_value="/tmp/sense4hri-bench/bus", description="the private D-Bus"),
            OpaqueFunction(function=_nodes),
        ]
    )
