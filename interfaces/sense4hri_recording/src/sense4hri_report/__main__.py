"""`sense4hri-report FOLDER...`: how complete recorded sessions are, as report.json and report.html in each folder."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sense4hri.plain_text import plain
from sense4hri_recording.errors import SessionError
from sense4hri_recording.layout import REPORT_HTML
from sense4hri_recording.parts import find

from sense4hri_report import make_report
from sense4hri_report.collect import Progress, silent


def main(arguments: list[str] | None = None) -> int:
    """Make the reports; 1 and one sentence where one cannot be made."""
    parser = argparse.ArgumentParser(prog="sense4hri-report", description=__doc__)
    parser.add_argument("recording", nargs="+", type=Path, help="any folder of a session, or FOLDER/SESSION_ID")
    parser.add_argument("--only-this-part", action="store_true", help="leave out the other folders of its session")
    parser.add_argument("--quiet", action="store_true", help="no progress")
    options = parser.parse_args(arguments)
    shown: Progress = _show if not options.quiet and sys.stderr.isatty() else silent
    status = 0
    for path in options.recording:
        try:
            folder = path if path.exists() else find(path)[0]
            summary = make_report(folder, shown, options.only_this_part)
        except SessionError as err:
            print(plain(str(err)), file=sys.stderr)
            status = 1
            continue
        print(plain(f"{folder / REPORT_HTML}: {summary['verdict']}: {summary['why']}"))
    return status


def _show(read: int, total: int) -> None:
    print(f"\r{100 * read // max(total, 1)} %", end="\r" if read >= total else "", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
