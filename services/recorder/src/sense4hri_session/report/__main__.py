"""`sense4hri-report FOLDER...`: how complete recorded sessions are, as report.json and report.html in each folder."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from sense4hri_session.errors import SessionError
from sense4hri_session.report import HTML_NAME, make_report


def main(arguments: list[str] | None = None) -> int:
    """Make the reports; 1 and one sentence where one cannot be made."""
    parser = argparse.ArgumentParser(prog="sense4hri-report", description=__doc__)
    parser.add_argument("recording", nargs="+", type=Path, help="folder of a recording")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    status = 0
    for folder in options.recording:
        try:
            summary = make_report(folder, not options.quiet and sys.stderr.isatty())
        except SessionError as err:
            print(err, file=sys.stderr)
            status = 1
            continue
        print(f"{folder / HTML_NAME}: {summary['verdict']}: {summary['why']}")
    return status


if __name__ == "__main__":
    sys.exit(main())
