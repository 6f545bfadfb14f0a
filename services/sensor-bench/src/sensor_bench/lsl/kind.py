"""Senders of LSL streams as a kind of the bench: the keys of a device, and what it is made of."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from sensor_bench.device import DeviceKeys, Kind
from sensor_bench.lsl.feeds import ELECTRODES, EcgFeed, EegFeed, Feed, GazeFeed
from sensor_bench.lsl.recording import RecordedFeed, RecordedSender
from sensor_bench.lsl.sender import Sender
from sensor_bench.room import Room

RATES_HZ = {"LslEcg": 500.0, "LslEeg": 250.0, "LslGaze": 60.0}
RECORDING = "LslRecording"


@dataclass(frozen=True, kw_only=True)
class LslKeys(DeviceKeys):
    """One sender as the configuration describes it."""

    name: str = ""
    """Of its stream; empty = the sensor's."""
    source_id: str = ""
    rate_hz: float = 0.0
    """0 = as usual for the model; of gaze, how many irregular samples come in a second."""
    channels: int = 8
    """Of an EEG."""
    clock_ahead_s: float = 0.0
    """Of its machine's clock on this host's, in whole seconds; other than 0 needs the right to a time namespace."""
    loss: float = 0.0
    session: str = ""
    """LSL's SessionID, as driver-lsl's parameter."""
    file: str = ""
    """The XDF that LslRecording sends."""
    start_s: float = 0.0

    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = (
        ("rate_hz", 0, 10_000),
        ("channels", 1, len(ELECTRODES)),
        ("clock_ahead_s", -1e5, 1e9),
        ("loss", 0, 1),
        ("start_s", 0, 1e6),
    )

    def check(self) -> None:
        super().check()
        if (self.model == RECORDING) != bool(self.file):
            raise ValueError(f"file: {self.file!r}: an {RECORDING} has one, nothing else has")
        if self.file and not Path(self.file).is_file():
            raise ValueError(f"file: no such file: {self.file}")


def make(room: Room, keys: LslKeys) -> Sender:
    """A sender on its own machine."""
    if keys.model == RECORDING:
        return RecordedSender(room, keys, RecordedFeed(Path(keys.file), keys.start_s), keys.session, keys.loss)
    return Sender(room, keys, _feed(room, keys), keys.session, keys.loss, keys.clock_ahead_s)


def _feed(room: Room, keys: LslKeys) -> Feed:
    name, source_id = keys.name or keys.sensor, keys.source_id or f"bench-{keys.sensor}"
    rate_hz, seed = keys.rate_hz or RATES_HZ[keys.model], room.seed_of(keys.sensor)
    if keys.model == "LslEeg":
        return EegFeed(name, source_id, rate_hz, keys.channels, seed)
    feed: type[EcgFeed | GazeFeed] = EcgFeed if keys.model == "LslEcg" else GazeFeed
    return feed(name, source_id, rate_hz, room.hearts[keys.participant], seed)


LSL = Kind(
    (*RATES_HZ, RECORDING),
    LslKeys,
    make,
    'name (of the stream; default: the sensor), source_id, session "" (LSL\'s SessionID), rate_hz (500, 250, 60), '
    "channels 8 (of LslEeg), loss 0 (of each sample), clock_ahead_s 0 (of its machine's clock), "
    "file and start_s 0 (the XDF of LslRecording)",
)
