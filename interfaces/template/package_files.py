"""The files that make a folder with code a package, for pip and for colcon, from its pyproject.toml and imports.

What a package declares, in its pyproject.toml: `[project]` name, description, dependencies, extras and further scripts,
`[tool.sense4hri]` (`kind = "commands"` or `"library"`: no node; `apt`: Debian packages for its image;
`messages`: message packages it knows by the names of their types alone; `lent`: modules of the kit whose libraries are
dependencies of the packages that import such a module, and not of the kit) and
`[tool.setuptools.package-data]`. The description says in half a sentence what the package does; it is also the
first line of its module's docstring. Everything else in these files is the same everywhere. Standard library only.
"""

from __future__ import annotations

import ast
import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
KIT = ROOT / "interfaces" / "sense4hri"
DISTRIBUTIONS = {
    "yaml": "pyyaml",
    "dbus_fast": "dbus-fast",
    "prometheus_client": "prometheus-client",
    "pywt": "pywavelets",
    "zmq": "pyzmq",
    "sense4hri_report": "sense4hri_recording",
}
"""Of an imported name, where the two differ."""
ROSDEP = {
    "aiohttp": "python3-aiohttp",
    "numpy": "python3-numpy",
    "pandas": "python3-pandas",
    "prometheus-client": "python3-prometheus-client",
    "pywavelets": "python3-pywt",
    "pyyaml": "python3-yaml",
    "scipy": "python3-scipy",
    "tqdm": "python3-tqdm",
    "zstandard": "python3-zstandard",
}
"""Of a distribution, where rosdep has one."""
ROS = re.compile(r"rclpy|rosidl_\w+|rpyutils|ament_index_python|\w+_msgs|\w+_interfaces|launch|launch_ros")
SETUP = """\
import os

from setuptools import setup

# A build from a checkout names the commit, as in 0.2.0+37.g90e5ed1; without it the release alone is known.
# Here and not in pyproject.toml, because colcon cannot read a requires-python from there.
setup(version=os.environ.get("SENSE4HRI_VERSION", "{release}"), python_requires=">=3.11")
"""
SETUP_CFG = """\
[develop]
script_dir=$base/lib/{name}
[install]
install_scripts=$base/lib/{name}
"""
PACKAGE_XML = """\
<?xml version="1.0"?>
<package format="3">
  <name>{name}</name>
  <version>{release}</version>
  <description>{description}</description>
  <maintainer email="sense4hri@users.noreply.github.com">Sense4HRI developers</maintainer>
  <license>Apache-2.0</license>
{depends}  <export>
    <build_type>ament_python</build_type>
  </export>
</package>
"""
LAUNCH = '''\
"""Start {folder}; `params_file:=` names its YAML file."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PACKAGE = "{name}"


def generate_launch_description() -> LaunchDescription:
    default = PathJoinSubstitution([FindPackageShare(PACKAGE), "config", "default.yaml"])
    return LaunchDescription(
        [
            SetEnvironmentVariable("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4"),
            DeclareLaunchArgument("params_file", default_value=default),
            Node(package=PACKAGE, executable=PACKAGE, parameters=[LaunchConfiguration("params_file")]),
        ]
    )
'''


def release() -> str:
    """Return the release that this tree is, or comes after."""
    return (ROOT / "VERSION").read_text().strip()


def is_node(declared: dict[str, Any]) -> bool:
    """True for a service that runs until it is stopped."""
    return declared.get("tool", {}).get("sense4hri", {}).get("kind", "node") == "node"


def imported(folder: Path) -> set[str]:
    """Return the top-level names that a package's modules import, its own and the standard library's left out."""
    lent = _lent(KIT)
    own = [path for path in (folder / "src").rglob("*.py") if path not in lent.values()]
    modules = {name for path in own for name in _imports(path)}
    modules |= {name for module, path in lent.items() if module in modules for name in _imports(path)}
    names = {name.partition(".")[0] for name in modules}
    return names - {path.stem for path in (folder / "src").iterdir()} - set(sys.stdlib_module_names)


def _lent(kit: Path) -> dict[str, Path]:
    """Return the files of the modules that the kit lends, by the name under which they are imported."""
    names = tomllib.loads((kit / "pyproject.toml").read_text())["tool"]["sense4hri"].get("lent", ())
    return {f"{kit.name}.{name}": kit / "src" / kit.name / f"{name}.py" for name in names}


def _imports(path: Path) -> set[str]:
    """Return the whole names of the modules that a module imports; `from x import y` may be `x` or `x.y`."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names |= {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def needed(folder: Path) -> set[str]:
    """Return the distributions a package's imports come from; ROS packages are in package.xml instead."""
    return {DISTRIBUTIONS.get(name, name) for name in imported(folder) if not ROS.fullmatch(name)}


def declared_dependencies(folder: Path) -> set[str]:
    """Return the names of the distributions that a package says it depends on."""
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    return {re.split(r"[\s<>=!~\[;]", text)[0] for text in project.get("dependencies", [])}


def files(folder: Path) -> dict[Path, str]:
    """Return every packaging file of a package's folder with its text."""
    declared = tomllib.loads((folder / "pyproject.toml").read_text())
    name = declared["project"]["name"]
    node = is_node(declared)
    texts = {
        "pyproject.toml": _pyproject(folder, declared, node),
        "setup.py": SETUP.format(release=release()),
        "setup.cfg": SETUP_CFG.format(name=name),
        "package.xml": _package_xml(folder, declared, node),
        f"resource/{name}": "",
        f"src/{name}/__init__.py": _module(folder / "src" / name / "__init__.py", declared["project"]["description"]),
    }
    if node:
        texts[f"launch/{name}.launch.py"] = LAUNCH.format(name=name, folder=folder.name)
    return {folder / path: text for path, text in texts.items()}


def _module(path: Path, description: str) -> str:
    """Return a package's module with the first line of its docstring as the description has it."""
    text = path.read_text() if path.is_file() else '""""""\n'
    return re.sub(r'\A"""[^"\n]*', lambda _: f'"""{description}.', text)


def _package_xml(folder: Path, declared: dict[str, Any], node: bool) -> str:
    project = declared["project"]
    ros = {name for name in imported(folder) if ROS.fullmatch(name)} | ({"launch", "launch_ros"} if node else set())
    ros |= set(declared.get("tool", {}).get("sense4hri", {}).get("messages", ()))
    python = declared_dependencies(folder)
    ours = {name for name in python if name.startswith("sense4hri")}
    keys = [*sorted(ros | ours), *sorted(ROSDEP[name] for name in python if name in ROSDEP)]
    depends = "".join(f"  <exec_depend>{key}</exec_depend>\n" for key in keys)
    description = project["description"].replace("&", "&amp;").replace("<", "&lt;")
    return PACKAGE_XML.format(name=project["name"], release=release(), description=description, depends=depends)


def _pyproject(folder: Path, declared: dict[str, Any], node: bool) -> str:
    project, tool = declared["project"], declared.get("tool", {})
    name = project["name"]
    share = {"ament_index/resource_index/packages": [f"resource/{name}"], name: ["package.xml"]}
    if node:
        share |= {f"{name}/config": ["config/default.yaml"], f"{name}/launch": [f"launch/{name}.launch.py"]}
    scripts = ({name: f"{name}.__main__:main"} if node else {}) | project.get("scripts", {})
    dependencies = "".join(f"    {json.dumps(text)},\n" for text in project.get("dependencies", []))
    parts = [
        '[build-system]\nrequires = ["setuptools>=68,<80"]\nbuild-backend = "setuptools.build_meta"\n',
        f'[project]\nname = {json.dumps(name)}\ndynamic = ["version", "requires-python"]\n'
        f"description = {json.dumps(project['description'], ensure_ascii=False)}\n"
        f'license = {{ text = "Apache-2.0" }}\ndependencies = [\n{dependencies}]\n',
        _table("project.optional-dependencies", project.get("optional-dependencies", {})),
        _table("project.scripts", scripts),
        _table("tool.sense4hri", tool.get("sense4hri", {})),
        _table("tool.setuptools.packages.find", {"where": ["src"]}),
        _table("tool.setuptools.package-data", tool.get("setuptools", {}).get("package-data", {})),
        _table("tool.setuptools.data-files", {f"share/{path}": names for path, names in share.items()}),
    ]
    return "\n".join(part for part in parts if part)


def _table(heading: str, entries: dict[str, Any]) -> str:
    lines = [f"{_key(key)} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in entries.items()]
    return f"[{heading}]\n{''.join(lines)}" if lines else ""


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else json.dumps(key)
