"""`sense4hri-withdraw --human p1 RECORDINGS...`: everything of a pseudonym out of recorded sessions.

Every file is written anew, read back and only then put in the old one's place. A withdrawal that is cut short leaves
each file whole, old or new, and `.withdrawal.json` beside them; the same command again finishes it.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from sense4hri.names import UNASSIGNED, is_human_id
from sense4hri.plain_text import plain
from sense4hri_recording import layout
from sense4hri_recording.errors import SessionError
from sense4hri_recording.lock import Lock
from sense4hri_recording.parts import with_its_name

from sense4hri_session.journal import JOURNAL
from sense4hri_session.withdrawal import Withdrawal
from sense4hri_session.withdrawn import MADE_ANEW, Withdrawn


def withdraw(
    folder: Path, human_id: str, also: tuple[str, ...] = (), dry_run: bool = False, progress: bool = False
) -> Withdrawn:
    """Remove everything of a pseudonym from one recording. also: globs of topics to remove besides.

    Raises SessionError where it is being recorded, is damaged, or another pseudonym's withdrawal was cut short there.
    """
    folder = now = with_its_name(folder)
    lock = _lock(folder)
    try:
        work = Withdrawal(folder, human_id, also, progress)
        found = work.look()
        if dry_run or not (found or work.resumed):
            return found
        work.change(found, lock.before_rename)
        now = found.now
    finally:
        lock.release()
        if not lock.found:
            (now / layout.LOCK).unlink(missing_ok=True)
    _report(found)
    return found


def find_folders(paths: list[Path]) -> list[Path]:
    """Every recording at or below these paths; copies in hidden folders, which may go with another one, last."""
    found: set[Path] = set()
    for path in paths:
        if not path.is_dir():
            raise SessionError(f"{path}: there is no such folder")
        files = [*path.rglob("*.mcap"), *path.rglob(JOURNAL)]
        found |= {file.parent for file in files}
    return sorted(found, key=lambda folder: (folder.parent.name.startswith("."), folder))


def _lock(folder: Path) -> Lock:
    """Hold the recorder's lock; raise SessionError where somebody else does."""
    try:
        return Lock(folder)
    except BlockingIOError as err:
        raise SessionError(f"{folder} is being recorded: stop that first") from err


def _report(found: Withdrawn) -> None:
    """Make the report anew where there was one."""
    if MADE_ANEW not in found.files:
        return
    command = [sys.executable, "-m", "sense4hri_report", str(found.now)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        found.files.append(f"no report was made, the old one is gone: {done.stderr.strip()[-200:]}")


def main(arguments: list[str] | None = None) -> int:
    """Withdraw; 1 where a recording had to be left as it is, 2 where it was not confirmed."""
    options = _options(arguments)
    try:
        folders = find_folders(options.recordings)
    except SessionError as err:
        print(plain(str(err)), file=sys.stderr)
        return 1
    if not options.dry_run and not options.yes and not _confirmed(options.human, len(folders)):
        return 2
    status, hits = 0, 0
    for folder in folders:
        if not folder.is_dir():
            continue  # a copy of a recording before it, that was killed under way and went with that
        try:
            hits += _withdraw_and_tell(folder, options)
        except (SessionError, OSError) as err:
            print(plain(f"not withdrawn: {err}"), file=sys.stderr)
            status = 1
    verb = "hold" if options.dry_run else "held"
    print(f"{hits} of {len(folders)} recordings {verb} something of {options.human}")
    return status


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="sense4hri-withdraw", description=__doc__.partition("\n")[0])
    parser.add_argument("recordings", nargs="+", type=Path, help="folders of recordings, or any folder above them")
    parser.add_argument("--human", required=True, help="the pseudonym")
    parser.add_argument(
        "--also", action="append", default=[], metavar="GLOB", help="topics to remove too; more than once"
    )
    parser.add_argument("--dry-run", action="store_true", help="only say what would be removed")
    parser.add_argument("--yes", action="store_true", help="do not ask")
    parser.add_argument("--quiet", action="store_true", help="no progress bar")
    options = parser.parse_args(arguments)
    if not is_human_id(options.human) or options.human == UNASSIGNED:
        parser.error(f"{options.human!r} is no pseudonym")
    return options


def _withdraw_and_tell(folder: Path, options: argparse.Namespace) -> bool:
    """Withdraw from one recording and print what was found; whether anything was. Raises SessionError, OSError."""
    progress = not options.quiet and sys.stderr.isatty()
    found = withdraw(folder, options.human, tuple(options.also), options.dry_run, progress)
    if found or found.undecided:
        print("\n".join(found.lines()))
    return bool(found)


def _confirmed(human_id: str, count: int) -> bool:
    """Ask; without a terminal the answer is no."""
    if not sys.stdin.isatty():
        print("nothing was done: --yes withdraws without asking, --dry-run shows what would go", file=sys.stderr)
        return False
    print(f"Everything of {human_id} in {count} recordings will be removed for good. Type the pseudonym to go on: ")
    try:
        answer = sys.stdin.readline().strip()
    except KeyboardInterrupt:
        answer = ""
    if answer != human_id:
        print(f"nothing was done: that is not {human_id}", file=sys.stderr)
    return answer == human_id


if __name__ == "__main__":
    sys.exit(main())
