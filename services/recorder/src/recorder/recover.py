"""Makes recordings that a recorder left behind unfinished whole again; the recorder runs this when it starts.

    python -m recorder.recover FOLDER...

Every file is repaired as `sense4hri-repair` does it; recorder.json then says that the recording was
interrupted, with the counts of what is there. A recording that somebody writes still is left alone.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from sense4hri.files import open_file
from sense4hri.plain_text import plain
from sense4hri_recording import chunks, recorder_json
from sense4hri_recording.errors import DAMAGE
from sense4hri_recording.layout import RESERVE
from sense4hri_recording.lock import Lock
from sense4hri_recording.reader import read_index
from sense4hri_recording.recorder_json import COMPLETE, INTERRUPTED, RECORDING, RecorderJson
from sense4hri_recording.repair import repair_folder

WHY = "the recorder was killed, or the machine lost its power"


class _Found(NamedTuple):
    """Messages by topic and type, without those repeated at the head of a file, and the last one's log time."""

    counts: Counter[tuple[str, str]]
    last_ns: int


def left_behind(root: Path) -> Iterator[Path]:
    """Folders at or below root whose recording was never closed and is written by nobody."""
    for folder, about in recorder_json.recordings(root):
        if about.state == RECORDING:
            try:
                Lock(folder).release()
            except OSError:
                continue
            yield folder


def recover(folder: Path) -> list[str]:
    """Repair one recording and return what was done, in sentences. Raises OSError, ValueError."""
    lock = Lock(folder)
    try:
        about = recorder_json.read(folder)
        if not about.state:
            raise ValueError(about.trouble or f"{recorder_json.NAME} does not say how far the recording has come")
        if about.state == COMPLETE:
            raise ValueError("it was closed in order; `sense4hri-repair` mends damaged files")
        (folder / RESERVE).unlink(missing_ok=True)
        done, failures, found = repair_folder(folder)
        told = [f"{one.path.name}: {one.told}" for one in done]
        told += [failure.removeprefix(f"{folder}/") for failure in failures]
        _close(folder, about, told, _counted([folder / each.file.name for each in found]))
        return told
    finally:
        lock.release()


def _close(folder: Path, about: RecorderJson, told: list[str], found: _Found) -> None:
    """Say in recorder.json what became of the recording."""
    counts, last_ns = found
    for topic in about.topics:
        topic["messages"] = counts.pop((str(topic.get("topic")), str(topic.get("type"))), 0)
    about.topics.extend(
        {"topic": topic, "type": type_name, "messages": count, "lost": 0, "missed_at_start": 0, "losses": []}
        for (topic, type_name), count in counts.items()
    )
    about.state, about.why = INTERRUPTED, WHY
    about.last_written_ns = last_ns or about.last_written_ns
    now_ns = time.time_ns()
    about.events.extend({"at_ns": now_ns, "what": what} for what in (WHY, *told))
    recorder_json.write(folder, about)


def _counted(files: Sequence[Path]) -> _Found:
    counts: Counter[tuple[str, str]] = Counter()
    last_ns = 0
    for path in files:
        summary, _ = read_index(path)
        with suppress(*DAMAGE), open_file(path) as file:  # of a whole file with a damaged chunk what is before it
            for channel, message in chunks.messages(file, summary):
                schema = summary.schemas.get(channel.schema_id)
                counts[channel.topic, schema.name if schema else ""] += message.sequence != 0
                last_ns = max(last_ns, message.log_time)
    return _Found(counts, last_ns)


def main(arguments: list[str] | None = None) -> int:
    """Recover what is named; 1 where something could not be."""
    parser = argparse.ArgumentParser(prog="recorder.recover", description=__doc__.partition("\n")[0])
    parser.add_argument("recording", nargs="+", type=Path)
    status = 0
    for folder in parser.parse_args(arguments).recording:
        try:
            told = recover(folder)
        except (OSError, ValueError, LookupError, TypeError) as err:
            print(plain(f"{folder}: not recovered: {err}"), file=sys.stderr)
            status = 1
            continue
        print(plain(f"{folder}: {'; '.join(told) or 'every file was whole'}"))
    return status


if __name__ == "__main__":
    sys.exit(main())
