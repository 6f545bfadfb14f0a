"""EDF+D and BDF+D: EDF+ whose data records need not follow each other; each tells when it began (edfplus.info).

Samples of a record are even from there on; between records there is what time there is. And every EDF or BDF whose
recorder was killed, as far as it goes: where nothing tells when its records began they follow each other.
"""

from collections.abc import Iterator
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.signal_files.content import Event, IntArray, Sampled, Signal, SignalFile, UnreadableFileError, evenly
from sense4hri.stamps import SECOND_NS

NAMES = (b"EDF+D", b"BDF+D")
STATUS, TRIGGERS = "Status", 0xFFFF
FIELDS = {"label": 16, "transducer": 80, "unit": 8, "least": 8, "most": 8, "least_count": 8, "most_count": 8}
FIELDS |= {"filter": 80, "samples": 8, "reserved": 32}
"""Signs of each, of all channels one after the other."""
BDF_BYTES = 3  # of a sample; EDF has 2
FIRST_YEAR = 1985  # of the two digits that a date has


class Channel(NamedTuple):
    """samples: in a record. begin: of its bytes there. A count times gain and offset is in the unit."""

    label: str
    unit: str
    samples: int
    begin: int
    gain: float
    offset: float


class Layout(NamedTuple):
    """record_bytes: of all channels. sample_bytes: 2 of EDF, 3 of BDF. announced: records as the header says."""

    path: Path
    start_ns: int
    header_bytes: int
    announced: int
    record_s: float
    record_bytes: int
    sample_bytes: int
    channels: tuple[Channel, ...]


def has_gaps(path: Path) -> bool:
    """True where the file says that it may have."""
    with path.open("rb") as file:
        return file.read(256)[192:197] in NAMES


def is_cut(path: Path) -> bool:
    """True where it holds fewer data records than its header says, or that does not say how many."""
    try:
        layout = _layout(path)
    except (ValueError, ArithmeticError, LookupError):
        return False
    return layout.announced < 0 or len(_records(layout)) < layout.announced


def codes(counts: NDArray[np.int32], times_ns: IntArray) -> Iterator[Event]:
    """Yield when the triggers of a BioSemi became another code than 0; how they stood at first is no event."""
    triggers = counts & TRIGGERS
    for at in (np.flatnonzero((np.diff(triggers) != 0) & (triggers[1:] != 0)) + 1).tolist():
        yield Event(int(times_ns[at]), str(triggers[at]), STATUS)


def open_gaps(path: Path) -> SignalFile:
    """Return what is in the file. Raises UnreadableFileError; ValueError and others of a damaged one."""
    layout = _layout(path)
    records = _records(layout)
    words = [each for each in layout.channels if each.label.endswith(" Annotations")]
    told = [[tal for each in words for tal in _tals(_octets(layout, record[None], each))] for record in records]
    for number, tals in enumerate(told if words else ()):
        if not tals or tals[0][1][:1] != [""]:
            raise UnreadableFileError(f"{path}: data record {number} does not tell when it began")
    even_ns = evenly(1 / layout.record_s, np.empty(len(records))).times_ns
    onsets_ns = np.array([tals[0][0] for tals in told], np.int64) if words else even_ns
    events = [Event(layout.start_ns + at_ns, text) for tals in told for at_ns, texts in tals for text in texts if text]
    sampled = [each for each in layout.channels if each not in words]
    if layout.sample_bytes == BDF_BYTES:
        for each in sampled:
            if each.label == STATUS:
                events += codes(_counts(layout, records, each), _times_ns(layout, each, onsets_ns))
    rates = dict.fromkeys(each.samples for each in sampled)
    signals = [_signal(layout, [each for each in sampled if each.samples == its], onsets_ns) for its in rates]
    ends = f"it ends after {len(records)} of its {layout.announced} data records"
    return SignalFile(tuple(signals), tuple(events), (ends,) if layout.announced > len(records) else ())


def _signal(layout: Layout, channels: list[Channel], onsets_ns: IntArray) -> Signal:
    def read(wanted: tuple[int, ...]) -> Sampled:
        chosen = [channels[number] for number in wanted]
        records = _records(layout)
        columns = [_counts(layout, records, each) * each.gain + each.offset for each in chosen]
        even = evenly(channels[0].samples / layout.record_s, np.column_stack(columns))
        return even._replace(times_ns=_times_ns(layout, channels[0], onsets_ns))

    names, units = tuple(each.label for each in channels), tuple(each.unit for each in channels)
    return Signal(names, units, read, bits=8 * layout.sample_bytes)


def _times_ns(layout: Layout, channel: Channel, onsets_ns: IntArray) -> IntArray:
    """Return when each sample of a channel was taken."""
    within = evenly(channel.samples / layout.record_s, np.empty(channel.samples))
    return np.asarray(layout.start_ns + (onsets_ns[:, None] + within.times_ns).ravel())


def _layout(path: Path) -> Layout:
    with path.open("rb") as file:
        head = file.read(256)
        count = int(head[252:256])
        table = {name: [file.read(width) for _ in range(count)] for name, width in FIELDS.items()}
    words = {name: [each.decode("latin-1").strip() for each in column] for name, column in table.items()}
    sample_bytes = BDF_BYTES if head[:1] == b"\xff" else 2
    samples = [int(each) for each in words["samples"]]
    if min(samples) < 0:
        raise UnreadableFileError(f"{path}: a channel of {min(samples)} samples in a data record")
    begins = np.cumsum([0, *samples]) * sample_bytes
    least, most, least_count, most_count = (
        [float(each) for each in words[name]] for name in ("least", "most", "least_count", "most_count")
    )
    gains = [(most[at] - least[at]) / (most_count[at] - least_count[at]) for at in range(count)]
    offsets = [least[at] - gains[at] * least_count[at] for at in range(count)]
    channels = map(Channel, words["label"], words["unit"], samples, begins.tolist(), gains, offsets)
    start = datetime.strptime(head[168:184].decode("latin-1"), "%d.%m.%y%H.%M.%S").replace(tzinfo=UTC)
    start = start.replace(year=FIRST_YEAR + (start.year - FIRST_YEAR) % 100)
    record_s, record_bytes = float(head[244:252]), int(begins[-1])
    if not (record_s > 0 and record_bytes > 0):
        raise UnreadableFileError(f"{path}: data records of {record_s:g} s and {record_bytes} bytes")
    told = int(start.timestamp()) * SECOND_NS, int(head[184:192]), int(head[236:244]), record_s, record_bytes
    return Layout(path, *told, sample_bytes, tuple(channels))


def _records(layout: Layout) -> NDArray[np.uint8]:
    """Return the bytes of every whole record, shape (records, bytes)."""
    octets = np.fromfile(layout.path, np.uint8, offset=layout.header_bytes)
    whole = len(octets) // layout.record_bytes
    count = min(whole, layout.announced) if layout.announced > 0 else whole  # -1 while it is being recorded
    return octets[: count * layout.record_bytes].reshape(count, layout.record_bytes)


def _octets(layout: Layout, records: NDArray[np.uint8], channel: Channel) -> NDArray[np.uint8]:
    return records[:, channel.begin : channel.begin + channel.samples * layout.sample_bytes]


def _counts(layout: Layout, records: NDArray[np.uint8], channel: Channel) -> NDArray[np.int32]:
    """Return the samples of a channel as the converter gave them, shape (n,)."""
    octets = _octets(layout, records, channel).reshape(-1, layout.sample_bytes)
    wide = np.zeros((len(octets), 4), np.uint8)
    wide[:, 4 - layout.sample_bytes :] = octets
    return np.asarray(wide.view("<i4").ravel() >> 8 * (4 - layout.sample_bytes))


def _tals(octets: NDArray[np.uint8]) -> list[tuple[int, list[str]]]:
    r"""Return onset in ns and texts of each `+12.5\x15duration\x14text\x14text\x14\0`."""
    found = []
    for tal in octets.tobytes().split(b"\0"):
        if tal:
            onset, *texts = tal.decode("utf-8", "replace").split("\x14")
            found.append((round(Decimal(onset.partition("\x15")[0]) * SECOND_NS), texts[:-1]))
    return found
