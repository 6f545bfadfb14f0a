"""A robot's own message package, dropped into interfaces/extra/, becomes part of the environment."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE_XML = """<package format="3">
  <name>robot_msgs</name><version>0.0.1</version><description>A "robot's" own</description>
  <maintainer email="lab@example.org">Lab</maintainer><license>BSD</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <depend>rosidl_default_generators</depend><depend>hri_msgs</depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export><build_type>ament_cmake</build_type></export>
</package>
"""
CMAKE = """cmake_minimum_required(VERSION 3.8)
project(robot_msgs)
find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
find_package(hri_msgs REQUIRED)
rosidl_generate_interfaces(${PROJECT_NAME} "msg/Greeting.msg" DEPENDENCIES hri_msgs)
ament_package()
"""
PROBE = """
from robot_msgs.msg import Greeting
from rclpy.serialization import deserialize_message, serialize_message
greeting = Greeting(text="hello")
greeting.face.expression = "happy"
assert deserialize_message(serialize_message(greeting), Greeting) == greeting
print("greeted")
"""


@pytest.mark.timeout(1200)
def test_plain_robot_package_is_built_and_imports(tmp_path):
    """A package that knows nothing of wheels, and uses hri_msgs, is built after it."""
    interfaces = tmp_path / "interfaces"
    shutil.copytree(ROOT / "interfaces", interfaces, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    shutil.copytree(ROOT / "build" / "wheels", tmp_path / "build" / "wheels")
    robot = interfaces / "extra" / "robot_msgs"
    (robot / "msg").mkdir(parents=True)
    (robot / "msg" / "Greeting.msg").write_text("string text\nhri_msgs/Expression face\n")
    (robot / "package.xml").write_text(PACKAGE_XML)
    (robot / "CMakeLists.txt").write_text(CMAKE)
    build = [sys.executable, str(interfaces / "message_wheels.py"), sys.executable]
    done = subprocess.run(build, text=True, capture_output=True, timeout=900, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr.splitlines()[-1] == "building the messages of robot_msgs"
    wheels = done.stdout.split()
    assert [Path(wheel).name.split("-")[0] for wheel in wheels][-1] == "robot_msgs"
    unpacked = tmp_path / "installed"
    command = [
        Path(sys.executable).parent / "uv",
        "pip",
        "install",
        "-q",
        "--no-deps",
        "--prefix",
        unpacked,
        wheels[-1],
    ]
    subprocess.run(command, check=True, timeout=600)
    environment = {name: value for name, value in os.environ.items() if name != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"} | {
        "PYTHONPATH": str(next((unpacked / "lib").glob("python*/site-packages"))),
        "LD_LIBRARY_PATH": str(unpacked / "lib"),
    }
    found = subprocess.run(
        [sys.executable, "-c", PROBE], env=environment, text=True, capture_output=True, timeout=600, check=False
    )
    assert found.stdout.strip() == "greeted", found.stderr
