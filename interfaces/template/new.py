"""Writes a new service that works: `make new KIND=driver|interpreter|service NAME=...`.

A driver `foo` becomes services/driver-foo; an interpreter's name is the sensor type it reads. Folder, packaging files,
role files as stubs, README, unit test, compose entry and status row; then `make env` installs it.
"""

import importlib
import re
import sys
from pathlib import Path

import generate
import package_files
from sense4hri.modalities import MODALITIES

ROOT = package_files.ROOT
FILES = Path(__file__).resolve().parent / "files"
KINDS = ("driver", "interpreter", "service")
DEPENDENCIES = {"driver": ("numpy", "sense4hri"), "interpreter": ("numpy", "sense4hri"), "service": ("sense4hri",)}
PUBLISHES = {
    "driver": "`raw` of `eda`, and `health`, beside what every driver publishes.",
    "interpreter": "`features` beside every raw stream of its sensor type.",
    "service": "Nothing yet.",
}
COMPOSE = """\
  {name}:
    <<: *service
    image: sense4hri/{name}
    build: {{context: .., dockerfile: services/Dockerfile, args: {{SERVICE: {name}}}}}

"""


def words_of(kind: str, short: str) -> dict[str, str]:
    """Return what stands for each placeholder. Raises ValueError for a kind or name that cannot be."""
    if kind not in KINDS:
        raise ValueError(f"KIND is {kind!r}, must be one of {', '.join(KINDS)}")
    if not re.fullmatch(r"[a-z][a-z0-9]*([-_][a-z0-9]+)*", short):
        raise ValueError(f"NAME is {short!r}, must be small letters, digits and single '-', as in my-sensor")
    sensor_type = short.replace("-", "_")
    message = MODALITIES[sensor_type].message if sensor_type in MODALITIES else ""
    if kind == "interpreter" and not message:
        able = ", ".join(each.sensor_type for each in MODALITIES.values() if each.message)
        raise ValueError(f"NAME is {short!r}, must be the sensor type it reads, one of {able}")
    name = short if kind == "service" else f"{kind}-{short.replace('_', '-')}"
    return {
        "name": name,
        "package": name.replace("-", "_"),
        "short": sensor_type,
        "title": name.replace("-", " ").capitalize(),
        "sensor_type": sensor_type,
        "message": message,
        "dependencies": ", ".join(f'"{each}"' for each in DEPENDENCIES[kind]),
        "publishes": PUBLISHES[kind],
        "method": "Wire format" if kind == "driver" else "Method",
    }


def write(kind: str, short: str) -> Path:
    """Write everything a new service needs; return its folder. Raises ValueError where it cannot be, or is there."""
    words = words_of(kind, short)
    folder = ROOT / "services" / words["name"]
    if folder.exists():
        raise ValueError(f"services/{words['name']} is there already")
    places = {"pyproject.toml": folder, "README.md": folder, "__init__.py": folder / "src" / words["package"]}
    for source in [*(FILES / "common").iterdir(), *(FILES / kind).iterdir()]:
        file = source.name.removesuffix(".in")
        target = places.get(file, folder / "src" / words["package"]) / file
        if file == "test.py":
            target = ROOT / "tests" / "unit" / words["name"] / f"test_{words['package']}.py"
        put(target, re.sub(r"@(\w+)@", lambda found: words[found[1]], source.read_text()))
    for path, text in package_files.files(folder).items():
        put(path, text)
    enter(words)
    sys.path.insert(0, str(folder / "src"))
    importlib.invalidate_caches()
    for path, text in (generate.parameters.files(folder) | generate.devices.files(ROOT)).items():
        put(path, text)
    return folder


def enter(words: dict[str, str]) -> None:
    """Give the service its entry in compose.yaml and its row in the status table."""
    compose, table = ROOT / "compose" / "compose.yaml", ROOT / "services" / "README.md"
    before, mark, after = compose.read_text().rpartition("  prometheus:\n")
    compose.write_text(before + COMPOSE.format(**words) + mark + after)
    rows = table.read_text().splitlines(keepends=True)
    last = max(i for i, line in enumerate(rows) if line.startswith("| "))
    rows.insert(last + 1, f"| {words['name']} | written by `make new`, does nothing yet | nothing yet |\n")
    table.write_text("".join(rows))


def put(path: Path, text: str) -> None:
    """Write a file, with its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def main() -> int:
    """Write what the command line names; return the exit status."""
    if len(sys.argv) != 3:
        print("make new KIND=driver|interpreter|service NAME=...", file=sys.stderr)
        return 2
    try:
        folder = write(sys.argv[1], sys.argv[2])
    except ValueError as err:
        print(f"new: {err}", file=sys.stderr)
        return 2
    print(f"new: {folder.relative_to(ROOT)}; README, src and the unit test wait for you; make env installs it")
    return 0


if __name__ == "__main__":
    sys.exit(main())
