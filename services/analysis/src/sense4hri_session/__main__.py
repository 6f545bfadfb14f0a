"""`sense4hri-export RECORDING`: a session as Parquet, CSV, EDF+, XDF and BIDS."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

from sense4hri.plain_text import plain
from sense4hri_recording.errors import SessionError
from sense4hri_recording.parts import find
from sense4hri_report import make_report

import sense4hri_session
from sense4hri_session import share
from sense4hri_session.export import FORMATS, export, mark
from sense4hri_session.session import Session


def main(arguments: list[str] | None = None) -> int:
    """Export, or list with --list; 1 and one sentence where that cannot be done."""
    parser = argparse.ArgumentParser(prog="sense4hri-export", description=__doc__)
    parser.add_argument("recording", type=Path, help="any folder of a session, FOLDER/SESSION_ID, or one .mcap file")
    parser.add_argument("--only-this-part", action="store_true", help="leave out the other folders of its session")
    parser.add_argument("--out", type=Path, help="new folder to write; default: RECORDING_export beside it")
    parser.add_argument("--formats", nargs="+", choices=FORMATS, help="which; default: all of them")
    parser.add_argument(
        "--share",
        action="store_true",
        help="without hosts, serial numbers, addresses and paths; adds such a copy",
    )
    parser.add_argument("--list", action="store_true", help="only say what is in it")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    try:
        if options.share and not options.list:
            target = _shared(options)
        else:
            session = sense4hri_session.open(options.recording, _progress(options), options.only_this_part)
            if options.list:
                _tell(session.notes)
                _list(session)
                return 0
            target = options.out or _beside(session.path, "export")
            _export(session, target, options)
    except (SessionError, OSError) as err:
        print(plain(str(err)), file=sys.stderr)
        return 1
    print(target)
    return 0


def _list(session: Session) -> None:
    counts = session.sample_counts()
    for key, stream in session.streams.items():
        about = key, f"{counts[key]} samples", stream.rate_in_words, ",".join(stream.channels), stream.unit
        print("\t".join(map(plain, about)))


def _export(session: Session, target: Path, options: argparse.Namespace) -> None:
    formats = tuple(options.formats) if options.formats else None
    known = session.notes
    _tell(known)
    _tell(note for note in export(session, target, formats, _progress(options)) if note not in known)


def _tell(notes: Iterable[str]) -> None:
    for note in notes:
        print(plain(note), file=sys.stderr)


def _shared(options: argparse.Namespace) -> Path:
    """Export a copy that does not tell of the lab, and put the copy, with its reports, beside what was exported."""
    folders = find(options.recording, options.only_this_part)
    target: Path = options.out or _beside(folders[0], "shared")
    if target.exists():
        raise SessionError(f"{target} exists already and is left as it is: name another folder")
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as scratch:
        mark(Path(scratch), [{"folder": folder.name} for folder in folders])
        copies = share.copy(options.recording, Path(scratch), options.only_this_part, _progress(options))
        session = sense4hri_session.open(copies[0], _progress(options), options.only_this_part)
        make_report(copies[0])
        _export(session, target, options)
        (target / share.RECORDING).mkdir()
        for copied in copies:
            copied.rename(target / share.RECORDING / copied.name)
    return target


def _beside(path: Path, kind: str) -> Path:
    own = path.resolve()
    return own.with_name(f"{own.stem if own.is_file() else own.name}_{kind}")


def _progress(options: argparse.Namespace) -> bool:
    return not options.quiet and sys.stderr.isatty()


if __name__ == "__main__":
    sys.exit(main())
