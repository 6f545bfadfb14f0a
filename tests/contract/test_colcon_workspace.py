"""Everything here is also a ROS 2 workspace: colcon builds messages, kit and services over the wheels as underlay."""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import package_files
import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECTS = [tomllib.loads(path.read_text()) for path in sorted((ROOT / "services").glob("*/pyproject.toml"))]
NODES = [each["project"]["name"] for each in PROJECTS if package_files.is_node(each)]
BIN = Path(sys.executable).parent
PROBE = """
import sys
from pathlib import Path
import sense4hri, sense4hri_recording, sense4hri_session, sense4hri_msgs.msg, hri_msgs.msg
from ament_index_python.packages import get_package_prefix
from rclpy.serialization import serialize_message
serialize_message(sense4hri_msgs.msg.ECG())
workspace = Path(sys.argv[1])
assert workspace in Path(get_package_prefix("sense4hri_session")).parents
assert workspace in Path(sense4hri_recording.__file__).parents
for name in sys.argv[2:]:
    assert workspace in Path(get_package_prefix(name)).parents, name
    assert (Path(get_package_prefix(name)) / "lib" / name / name).exists(), f"ros2 run {name} {name}"
    assert list((Path(get_package_prefix(name)) / "share" / name / "launch").glob("*.launch.py")), name
assert workspace in Path(sense4hri_msgs.__file__).parents, sense4hri_msgs.__file__
print("workspace complete")
"""


def underlay(folder: Path) -> Path:
    """A new environment with the locked ROS wheels, the generators and colcon, but nothing of this repository."""
    python = folder / "bin" / "python"
    uv = BIN / "uv"
    subprocess.run([uv, "venv", "-q", "--python", sys.executable, folder], check=True, timeout=600)
    install = [uv, "pip", "install", "-q", "--python", python, "--require-hashes", "-r"]
    subprocess.run([*install, ROOT / "interfaces" / "build-requirements.lock"], check=True, timeout=600)
    locks = [ROOT / "requirements.lock", "-r", ROOT / "requirements-test.lock"]  # colcon is a test tool
    subprocess.run([*install, *locks], check=True, timeout=600)
    return folder


@pytest.mark.slow
@pytest.mark.timeout(2300)
def test_colcon_builds_the_whole_workspace(tmp_path):
    """`colcon build` of interfaces/ and services/ succeeds, and everything is found after sourcing the workspace."""
    prefix = underlay(tmp_path / "ros")
    workspace = tmp_path / "workspace"
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "node_modules")
    for folder in ("interfaces", "services"):
        shutil.copytree(ROOT / folder, workspace / "src" / folder, ignore=ignored)
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "VIRTUAL_ENV", "LD_LIBRARY_PATH")
    } | {
        "PATH": f"{prefix / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "AMENT_PREFIX_PATH": str(prefix),
        "CMAKE_PREFIX_PATH": str(prefix),
        "MAKEFLAGS": f"-j{len(os.sched_getaffinity(0))}",  # colcon's own -l waits while others use the machine
    }
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    build = [prefix / "bin" / "colcon", "build", "--executor", "sequential", "--cmake-args"]
    build += [f"-DPython3_EXECUTABLE={prefix / 'bin' / 'python'}", "-DBUILD_TESTING=OFF"]
    done = subprocess.run(
        build, cwd=workspace, env=environment, text=True, capture_output=True, timeout=2200, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-6000:]
    script = 'source install/setup.bash && exec python -c "$0" "$@"'
    probe = ["bash", "-c", script, PROBE, str(workspace / "install"), *NODES]
    found = subprocess.run(
        probe, cwd=workspace, env=environment, text=True, capture_output=True, timeout=600, check=False
    )
    assert found.stdout.strip().endswith("workspace complete"), found.stdout + found.stderr
