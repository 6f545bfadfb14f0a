"""What whoever uses a recording should know before: sentences about one opened session."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from sense4hri_recording.parts import parts
from sense4hri_report.rules import counted

from sense4hri_session.scan import Scan

if TYPE_CHECKING:
    from sense4hri_session.session import Session

MOST_UNITS = 4  # that a sentence names


def told(session: Session, scan: Scan) -> Iterator[str]:
    """Yield a sentence for each thing that is not as a user would expect it."""
    yield from _of_recorders(session)
    yield from _unplaced_hosts(session, scan)
    yield from _pauses(session)
    yield from _changed_channels(session)
    yield from _strangers(session, scan)
    yield from _odd_stamps(session)
    yield from _other_rates(session)
    yield from _other_units(session, scan)
    yield from _undecodable(session)


def _of_recorders(session: Session) -> Iterator[str]:
    """What the recorder doubts, and parts that were left out."""
    for part, recorder in zip(session.reader.parts, session.recorders, strict=True):
        for doubt in recorder.doubts(part.path):
            yield doubt.replace(str(part.path), part.path.name)
    others = [part for part in parts(session.path) if part != session.path] if session.path.is_dir() else []
    if others and len(session.reader.parts) == 1:
        names = ", ".join(path.name for path in others)
        which = f"one of {len(others) + 1} folders of its session"
        yield f"{session.path.name} is {which}, opened alone; the others: {names}"


def _unplaced_hosts(session: Session, scan: Scan) -> Iterator[str]:
    received = ((stream.name.sensor_id, stream.seen.received_ns) for stream in session.streams.values())
    ends = ((sensor_id, (min(stamps_ns), max(stamps_ns)) if stamps_ns else ()) for sensor_id, stamps_ns in received)
    yield from sorted({doubt for sensor_id, ends_ns in ends if (doubt := scan.hosts.doubt(sensor_id, ends_ns))})


def _pauses(session: Session) -> Iterator[str]:
    yield from (pause.sentence for pause in session.reader.pauses)


def _changed_channels(session: Session) -> Iterator[str]:
    yield from (
        f"{key} came with {len(stream.seen.channel_sets)} sets of channels "
        f"({'; '.join(', '.join(names) for names in list(stream.seen.channel_sets)[:4])}): "
        "a channel is empty where it was not sent"
        for key, stream in session.streams.items()
        if len(stream.seen.channel_sets) > 1
    )


def _strangers(session: Session, scan: Scan) -> Iterator[str]:
    for name in sorted(scan.seen):
        if name.fault:
            yield f"{'/'.join(name)}: its name breaks the contract ({name.fault}): no service followed it"
    for topic, why in sorted(session.strange.items()):
        yield f"{topic} ({session.reader.topics[topic].messages} messages) is read as a plain table: {why}"


def _odd_stamps(session: Session) -> Iterator[str]:
    for key, stream in session.streams.items():
        if stream.seen.receipts.odd:
            yield f"{key}: {stream.seen.receipts.odd} receipt stamps are more than an hour off the others"


def _other_rates(session: Session) -> Iterator[str]:
    for key, stream in session.streams.items():
        told_hz, true_hz = stream.sampling_frequency_hz, stream.true_rate_hz
        if true_hz != told_hz:
            yield f"{key} declares {told_hz:g} Hz and came at {true_hz:.2f} Hz: its samples are placed by the latter"


def _other_units(session: Session, scan: Scan) -> Iterator[str]:
    for key, stream in session.streams.items():
        told = scan.units.get((stream.name.sensor_id, stream.name.sensor_type), [])
        if len(told) > 1:
            words = [f"as {unit} from {(at_ns - session.start_ns) * 1e-9:.1f} s on" for at_ns, unit in told]
            yield f"{key}: its unit was told {', '.join(words[:MOST_UNITS])}: all of it is written as {stream.unit}"


def _undecodable(session: Session) -> Iterator[str]:
    for key, stream in session.streams.items():
        if stream.seen.undecodable:
            yield f"{key}: {counted(stream.seen.undecodable, 'raw message')} cannot be decoded: left out"
