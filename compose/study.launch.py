"""A study in a ROS 2 workspace: `ros2 launch compose/study.launch.py study:=demo`, or the path of a study file.

Starts what `make demo` starts, from the same file, without a session; named volumes are folders in `volumes:=`.
"""

import os
import sys
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration

sys.path.insert(0, str(Path(__file__).resolve().parent))

import several_hosts
import study_file

VOLUMES = Path.home() / ".ros" / "sense4hri"


def _processes(context: LaunchContext) -> list[ExecuteProcess | LogInfo]:
    study = study_file.read(study_file.find(LaunchConfiguration("study").perform(context)), os.environ)
    study = several_hosts.part(study, LaunchConfiguration("host").perform(context))
    volumes = Path(LaunchConfiguration("volumes").perform(context)).expanduser() / study.name
    for name in study.volumes():
        (volumes / name).mkdir(parents=True, exist_ok=True)
    left_out = [LogInfo(msg=f"{service.name} is left out: it has only an image") for service in study.only_images]
    return [*left_out, *(_process(service, volumes) for service in study.processes)]


def _process(service: study_file.Service, volumes: Path) -> ExecuteProcess:
    process = service.process(volumes)
    return ExecuteProcess(
        name=service.name, cmd=process.command, additional_env=process.env, cwd=process.folder, output="screen"
    )


def generate_launch_description() -> LaunchDescription:
    """Return one process per service of the study."""
    return LaunchDescription(
        [
            SetEnvironmentVariable("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4"),
            DeclareLaunchArgument("study", default_value="demo", description="name or path of a study file"),
            DeclareLaunchArgument("host", default_value="", description="which machine of a study on several this is"),
            DeclareLaunchArgument("volumes", default_value=str(VOLUMES), description="folder of the named volumes"),
            OpaqueFunction(function=_processes),
        ]
    )
