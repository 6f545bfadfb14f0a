"""`make study NAME=...`: writes a study file, from flags or, where there are none, from questions.

    make study NAME=pilot FLAGS="--participants 2 --sensors h10,verity --id h10_1=1A2B3C4D"
    make study NAME=dry_run FLAGS="--participants 8 --virtual"

The file is in compose/studies, says in comments what to edit, and passes `make check`. One that is there stays as it is
unless --force is given. Exit status 78 where something that was asked for cannot be.
"""

import argparse
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import check_study
import study_text
from sense4hri.names import meaning
from sensor_kinds import KINDS, Kind, Link, fits
from study_file import HUMAN_ID, STUDIES, WRONG
from study_text import Wish

MOST_KINDS = 12
YES_NO = {"yes": True, "y": True, "no": False, "n": False}
NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,63}")


class Refused(Exception):
    """What was asked for and cannot be, in a sentence."""


def _what(kind: Kind) -> str:
    """Return what a kind of sensor is, and how docs/devices.md calls it."""
    device = kind.row.device
    return device if kind.about in device else f"{kind.about} ({device})"


OFFERED = "".join(f"  {name:12} {_what(kind)}\n" for name, kind in KINDS.items())


class Question(NamedTuple):
    """A flag that is asked for: its name, the question, what an empty answer means."""

    flag: str
    text: str
    default: str


QUESTIONS = (
    Question("participants", "How many participants, or which (p1,p2)?", "1"),
    Question(
        "sensors",
        f"{OFFERED}Which sensors does each of them wear (several with a comma)?",
        "h10,verity",
    ),
    Question("virtual", "Virtual sensors, for a dry run (yes, no)?", "no"),
    Question("record_only", "Only record, without features and states (yes, no)?", "no"),
    Question("task", "What is done in a session (a word, or nothing)?", ""),
)


def main() -> int:
    """Write the file; return the exit status."""
    options = _parser().parse_args()
    folder = options.folder.resolve()
    try:
        wish = _wish(options)
        file = options.folder / f"{wish.name}.yaml"
        if not folder.is_dir():
            raise Refused(f"--folder {options.folder} is no folder")
        if file.exists() and not options.force:
            raise Refused(f"{file} is there already: give another NAME, or FLAGS=--force to write it anew")
        if asked(sys.argv[1:]):
            wish = _ask(options)
        _write(file, study_text.text(wish, folder))
    except Refused as refused:
        print(refused, file=sys.stderr)
        return WRONG
    print(f"written: {file}; edit it, then make check STUDY={study_text.called(wish, folder)}")
    found = check_study.findings(file.resolve(), "processes")
    check_study.print_all(found)
    return check_study.status(found)


def _write(file: Path, text: str) -> None:
    content = text.encode("utf-8", "surrogateescape")  # words of a terminal that Python takes for none of UTF-8
    try:
        content.decode("utf-8")
        file.write_bytes(content)
    except UnicodeDecodeError as error:
        raise Refused(f"{file} cannot be written: a word that was given is no text in UTF-8") from error
    except OSError as error:
        raise Refused(f"{file} cannot be written: {error.strerror}") from error


def asked(words: list[str]) -> bool:
    """Return whether questions are to be asked: nothing but a name is given, and somebody is there."""
    return len(words) == 1 and sys.stdin.isatty()


def wish_of(words: list[str]) -> Wish:
    """Return what these words of a command line ask for. Raises Refused."""
    return _wish(_parser().parse_args(words))


def _wish(options: argparse.Namespace) -> Wish:
    """Return what is to be written. Raises Refused."""
    if not options.name:
        raise Refused("NAME is missing: make study NAME=pilot")
    if not NAME.fullmatch(options.name):
        raise Refused(
            f"NAME {options.name!r} must be small letters, digits, _ and -, a letter or digit first, 64 at most"
        )
    participants = _participants(options.participants)
    kinds = [word.strip() for word in options.sensors.split(",") if word.strip()]
    for kind in kinds:
        if kind not in KINDS or kinds.count(kind) > 1:
            raise Refused(f"--sensors {kind!r}: give each once, of {', '.join(KINDS)}")
    if not kinds:
        raise Refused(f"--sensors: give at least one of {', '.join(KINDS)}")
    if len(kinds) > MOST_KINDS:
        raise Refused(f"--sensors: {len(kinds)} kinds are too many for one participant, {MOST_KINDS} at most")
    for kind in kinds if options.virtual else ():
        if not KINDS[kind].model and KINDS[kind].link is not Link.FILE:
            played = ", ".join(name for name, known in KINDS.items() if known.model)
            raise Refused(f"--virtual: nothing plays {kind!r}; of these there are virtual ones: {played}")
    wish = Wish(
        options.name,
        options.task,
        participants,
        tuple(kinds),
        {},
        options.virtual,
        options.record_only,
        options.replay,
        tuple(_extras(options)),
    )
    return wish._replace(ids=_ids(options.id, wish))


def _extras(options: argparse.Namespace) -> list[str]:
    """Return the services that are there unless they are not wanted."""
    wanted = {"web-gui": options.page, "prometheus": options.prometheus}
    return [name for name, yes in wanted.items() if yes]


def _participants(given: str) -> tuple[str, ...]:
    if given.isdecimal():
        if not 1 <= int(given) <= study_text.MOST:
            raise Refused(f"--participants {given}: 1 to {study_text.MOST}")
        return tuple(f"p{number}" for number in range(1, int(given) + 1))
    names = tuple(name.strip() for name in given.split(","))
    for name in names:
        if means := meaning(name):
            raise Refused(f"--participants {name!r}: it means {means}; give pseudonyms, or their number")
        if not HUMAN_ID.fullmatch(name) or not study_text.plain(name) or names.count(name) > 1:
            allowed = "pseudonyms of letters, digits and single '_', no word like y or null, each once, or their number"
            raise Refused(f"--participants {name!r}: {allowed}")
    return names


def _ids(given: list[str], wish: Wish) -> Mapping[str, str]:
    """Return the printed id or the address of sensors, by sensor_id."""
    ids = dict(entry.partition("=")[::2] for entry in given)
    known = {sensor.sensor_id: KINDS[sensor.kind] for sensor in study_text.sensors(wish)}
    for sensor_id, value in ids.items():
        if sensor_id not in known:
            raise Refused(f"--id {sensor_id}: the study's sensors are {', '.join(known)}")
        if wrong := fits(known[sensor_id], value):
            raise Refused(f"--id {sensor_id}={value}: {wrong}")
    return ids


def _ask(options: argparse.Namespace) -> Wish:
    """Return what is asked for with the answers; a question whose answer cannot be is asked again."""
    for question in QUESTIONS:
        while wrong := _take(options, question.flag, _answer(question)):
            print(wrong, file=sys.stderr)
    return _wish(options)


def _answer(question: Question) -> str:
    try:
        return input(f"{question.text} [{question.default}] ").strip() or question.default
    except (EOFError, KeyboardInterrupt) as error:
        raise Refused(f"\nnothing is written: no answer to: {question.text.splitlines()[-1]}") from error


def _take(options: argparse.Namespace, flag: str, answer: str) -> str:
    """Fill an option in from an answer; return why it cannot be, "" where it can."""
    is_choice = isinstance(getattr(options, flag), bool)
    if is_choice and answer.lower() not in YES_NO:
        return f"{answer!r} must be yes or no"
    setattr(options, flag, YES_NO[answer.lower()] if is_choice else answer)
    try:
        _wish(options)
    except Refused as refused:
        return str(refused)
    return ""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="make study", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("name", help="of the study; its file is NAME.yaml")
    parser.add_argument("--participants", default="1", help="how many, or their pseudonyms: p1,p2 (%(default)s)")
    parser.add_argument("--sensors", default="h10,verity", help=f"of each: {', '.join(KINDS)} (%(default)s)")
    parser.add_argument(
        "--id",
        action="append",
        default=[],
        metavar="SENSOR=ID",
        help="h10_1=1A2B3C4D, as printed on it; a port, a name or an address",
    )
    parser.add_argument("--virtual", action="store_true", help="no hardware: sensor-bench plays the sensors")
    parser.add_argument("--record-only", action="store_true", help="no features, no states")
    parser.add_argument(
        "--replay", action="store_true", help="no sensors: a recorded session is played and computed anew"
    )
    parser.add_argument("--task", default="", help="what is done in a session")
    parser.add_argument("--no-page", dest="page", action="store_false", help="without the page in the browser")
    parser.add_argument("--no-prometheus", dest="prometheus", action="store_false", help="without metrics and alerts")
    parser.add_argument("--force", action="store_true", help="write over the file that is there")
    parser.add_argument("--folder", type=Path, default=STUDIES, help="where it is written (compose/studies)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
