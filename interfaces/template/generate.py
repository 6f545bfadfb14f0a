"""Writes what follows from something else: `make generate`; with --check it only says what differs, and ends with 1.

.venv/bin/python interfaces/template/generate.py [--check]
"""

import sys
from pathlib import Path

import devices
import package_files
import parameters

ROOT = Path(__file__).resolve().parents[2]


def services(root: Path = ROOT) -> list[Path]:
    """Return the folders of all services that are a node."""
    return sorted(path.parents[1] for path in root.glob("services/*/config/default.yaml"))


def packages(root: Path = ROOT) -> list[Path]:
    """Return the folders of all Python packages: the kit's and the services'."""
    return sorted(path.parent for path in [*root.glob("interfaces/*/setup.cfg"), *root.glob("services/*/setup.cfg")])


def differing(root: Path = ROOT) -> dict[Path, str]:
    """Return the files that are not as they must be, with the text they must have."""
    wanted = {path: text for folder in packages(root) for path, text in package_files.files(folder).items()}
    wanted |= {path: text for service in services(root) for path, text in parameters.files(service).items()}
    wanted |= devices.files(root)
    return {path: text for path, text in wanted.items() if not path.is_file() or path.read_text() != text}


def main() -> int:
    """Write, or with --check only name, what differs; return the exit status."""
    differs, check = differing(), "--check" in sys.argv[1:]
    for path, text in differs.items():
        print(f"{path.relative_to(ROOT)} {'differs: make generate' if check else 'written'}")
        if not check:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
    return int(check and bool(differs))


if __name__ == "__main__":
    sys.exit(main())
