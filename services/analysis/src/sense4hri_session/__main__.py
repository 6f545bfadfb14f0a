"""`sense4hri-export RECORDING`: a session as Parquet, CSV, EDF+, XDF and BIDS."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sense4hri_recording.errors import SessionError

import sense4hri_session
from sense4hri_session.export import FORMATS, export


def main(arguments: list[str] | None = None) -> int:
    """Export, or list with --list; 1 and one sentence where that cannot be done."""
    parser = argparse.ArgumentParser(prog="sense4hri-export", description=__doc__)
    parser.add_argument("recording", type=Path, help="any folder of a session, FOLDER/SESSION_ID, or one .mcap file")
    parser.add_argument("--only-this-part", action="store_true", help="leave out the other folders of its session")
    parser.add_argument("--out", type=Path, help="new folder to write; default: RECORDING_export beside it")
    parser.add_argument("--formats", nargs="+", default=list(FORMATS), choices=FORMATS)
    parser.add_argument("--list", action="store_true", help="only say what is in it")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    progress = not options.quiet and sys.stderr.isatty()
    try:
        session = sense4hri_session.open(options.recording, progress, options.only_this_part)
        target = options.out or session.path.resolve().with_name(f"{session.path.resolve().stem}_export")
        for note in session.notes:
            print(note, file=sys.stderr)
        if options.list:
            for key, stream in session.streams.items():
                rate = f"{stream.measured_rate_hz:.2f} Hz"
                print(f"{key}\t{stream.seen.samples} samples\t{rate}\t{','.join(stream.channels)}\t{stream.unit}")
            return 0
        for note in export(session, target, tuple(options.formats), progress)[len(session.notes) :]:
            print(note, file=sys.stderr)
    except SessionError as err:
        print(err, file=sys.stderr)
        return 1
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
