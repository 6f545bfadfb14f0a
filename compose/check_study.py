"""`make check`: what is wrong with a study, before anything starts.

One line per finding, with its file and line. Errors: the study does not start, or does not do what its file says.
Warnings: it starts, and waits for something or does less than one may expect. Exit status 0 where there is no error, 78
where there is one.
"""

import argparse
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import several_hosts
import study_file
from arguments import positive
from checks import bench, docker, form, hosts, machine, names, parameters, surroundings
from checks.finding import Finding, Places
from compose_yaml import StudyError
from study_file import WRONG, Study

ROOT = Path(__file__).resolve().parents[1]
HOURS = 2.0
KINDS = ("processes", "containers")


def main() -> int:
    """Print what is wrong with a study; return the exit status."""
    options = _options()
    try:
        file = study_file.find(options.study)
    except StudyError as error:
        print(error, file=sys.stderr)
        return WRONG
    kind = options.as_ or ("containers" if docker.answers() else "processes")
    found = findings(file, kind, options.hours, options.recordings, host=options.host)
    print_all(found)
    if not options.as_ and kind == "processes":
        print("left out, for no Docker Engine answers: images, published ports, the disk of Docker's volumes")
    if options.strict:
        return WRONG if found else 0
    return status(found)


def findings(
    file: Path,
    kind: str,
    hours: float = HOURS,
    recordings: Path = ROOT / "recordings",
    environment: Mapping[str, str] = os.environ,
    host: str | None = None,
) -> list[Finding]:
    """Return all that is wrong with a study, in the order of the files' lines.

    kind: one of KINDS; hours: how long is recorded; host: which machine this is, of a study on several, empty where it
    is on one; None = a look at the whole study, wherever that is.
    """
    here = {"RECORDINGS": str(recordings.resolve())} if kind == "processes" else {}
    if kind == "processes" and not environment.get("GUI_PORT") and (port := machine.page_port()):
        here["GUI_PORT"] = str(port)
    places = Places(file)
    try:
        study, wrong = study_file.examine(file, dict(environment) | here)
        mine = study if host is None else several_hosts.part(study, host)
    except StudyError as error:
        return [places.of(error)]
    found = [*map(places.of, wrong), *_all(study, kind, places), *_here(mine, kind, hours, recordings, places)]
    if kind == "processes" and not wrong and "replay" not in study.packages:
        found += names.refused(study, places)
    found += hosts.findings(study, host or "", kind == "containers", places)
    if kind == "containers" and not status(found):
        found += docker.unread(file, places)
    return sorted(dict.fromkeys(found), key=lambda each: (each.file != file, str(each.file), each.line))


def _all(study: Study, kind: str, places: Places) -> Iterator[Finding]:
    """Yield what is wrong wherever it runs."""
    yield from parameters.findings(study, places)
    yield from form.findings(study, places)
    yield from surroundings.findings(study, places)
    yield from names.findings(study, places)
    yield from bench.findings(study, places)
    if kind == "processes":
        yield from names.session(study, places)


def _here(study: Study, kind: str, hours: float, recordings: Path, places: Places) -> Iterator[Finding]:
    """Yield what this machine lacks for its part of the study."""
    yield from machine.findings(study, places)
    if kind == "processes":
        yield from machine.for_processes(study, recordings.resolve(), places)
        yield from machine.room(study, recordings, hours, places)
    elif docker.answers():
        yield from docker.findings(study, places)
        given = os.environ.get("RECORDINGS", "")
        yield from machine.room(study, Path(given) if given.startswith("/") else docker.root(), hours, places)
    else:
        yield Finding(study.file, 0, "error", "no Docker Engine answers. On Debian: apt-get install docker.io")


def print_all(found: list[Finding]) -> None:
    """Print them, a line each, and how many there are."""
    for each in found:
        print(each._replace(file=_shown(each.file)))
    errors = sum(each.severity == "error" for each in found)
    print(f"{errors} errors, {len(found) - errors} warnings" if found else "nothing is wrong")


def status(found: list[Finding]) -> int:
    """Return the exit status of these findings."""
    return WRONG if any(each.severity == "error" for each in found) else 0


def _shown(file: Path) -> Path:
    """Return the path as one would type it here."""
    here = Path.cwd()
    return file.relative_to(here) if file.is_relative_to(here) else file


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="make check", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--study", default="demo", help="name of a study in compose/studies, or path of a study file")
    parser.add_argument(
        "--as", dest="as_", choices=KINDS, help="how it is to be started; containers, where a Docker Engine answers"
    )
    parser.add_argument(
        "--hours", type=positive, default=HOURS, help="how long is recorded, for the disk (%(default)s)"
    )
    parser.add_argument("--recordings", type=Path, default=ROOT / "recordings", help="folder of plain processes")
    parser.add_argument("--host", help="of a study on several machines: which of them this is")
    parser.add_argument("--strict", action="store_true", help="warnings count as errors")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
