"""Pupil Core as the kit sees it: connects to Pupil Capture, and yields until it is gone."""

from collections.abc import AsyncGenerator, Iterator, Mapping, Sequence
from contextlib import closing

from sense4hri.arrivals import Silence, from_thread
from sense4hri.clock_model import event_ns
from sense4hri.device import ClockMeasurement, Item, Marked, Reported, Stream
from sense4hri.errors import DeviceLost, FrameError
from sense4hri.stamps import SECOND_NS

from driver_pupil_labs import protocol
from driver_pupil_labs.config import PupilConfig
from driver_pupil_labs.eyes import WAIT_FRAMES, InOrder, Pairing, rate_hz
from driver_pupil_labs.protocol import MODELLED, Event, Gaze, Note, Pupil, Reading
from driver_pupil_labs.streams import LISTEN_S, Known, Rows, check_time_goes_on
from driver_pupil_labs.transport import CaptureLink, Heard, Message

SILENCE_S = 10.0  # without any picture of an eye
BITS = 64
LARGEST = {"mm": 10.0, "px": 400.0}  # of a pupil
GAZE = ("1", 0.0, 1.0, BITS, ("gaze_x", "gaze_y", "confidence"))
SLOWEST_HZ = 30.0


class Core:
    """A Device of the kit: the Pupil Capture or Service at one address."""

    def __init__(self, config: PupilConfig, streams: Mapping[str, Stream]) -> None:
        self._config = config
        self._link: CaptureLink | None = None
        self._offset_ns: int | None = None
        self._known = Known()

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Connect, then yield what Capture publishes and what its clock shows, until it is gone: DeviceLost."""
        with closing(CaptureLink(self._config.address, self._config.usual_port)) as link:
            self._link, self._offset_ns = link, None
            self._known.connected()
            silence, told = Silence(["picture of an eye"], SILENCE_S), Told(self._known)
            async with from_thread(link.read) as arrivals:
                while True:
                    try:
                        for heard in (await silence.watch(arrivals.get())).value:
                            for item in self._take(heard, told, silence):
                                yield item
                    except DeviceLost:
                        for item in told.rest():
                            yield item
                        raise
                    for item in told.items():
                        yield item

    def hear(self, marker: Marked) -> None:
        """Let Capture record a marker of the study, at its time; without a clock or a link it is not sent."""
        if self._link is None or self._offset_ns is None or not self._config.send_markers:
            return
        self._link.tell(protocol.annotation(marker.name, marker.value, marker.event_ns - self._offset_ns))

    def _take(self, heard: Message, told: "Told", silence: Silence) -> Sequence[Item]:
        """Decode one message; what cannot be decoded is handed on as the error that says why."""
        if not isinstance(heard, Heard):
            if isinstance(heard, ClockMeasurement):
                self._offset_ns, told.measured = heard.offset_ns, heard
            return (heard,)
        try:
            reading = protocol.decode(heard.topic, heard.payload)
            if isinstance(reading, Pupil):
                silence.broken_by("picture of an eye")
                self._spare_2d(heard.topic, told)
            return self._items(reading, heard.received_ns, told)
        except FrameError as err:
            return (err,)

    def _spare_2d(self, topic: str, told: "Told") -> None:
        """Let Capture no longer send what is left out anyway, once sizes are by topics of the 3d model."""
        if self._link is not None and told.in_mm and topic in MODELLED:
            self._link.hear_models_only()

    def _items(self, reading: Reading | None, received_ns: int, told: "Told") -> Sequence[Item]:
        match reading:
            case Gaze():
                told.gaze(reading, received_ns)
            case Pupil():
                told.pupil(reading, received_ns)
            case Event(time_ns, features):
                return (Reported("eye_tracking", received_ns, time_ns, features),)
            case Note(time_ns, name, value):
                return (Marked(event_ns(received_ns, time_ns, self._offset_ns), time_ns, name, value),)
        return ()


class Told:
    """What one connection has told so far: rows on their way out. known: the streams that are declared."""

    def __init__(self, known: Known | None = None) -> None:
        self._known = known or Known()
        self.measured: ClockMeasurement | None = None
        self._first: list[tuple[Pupil, int]] = []
        self._eyes: Eyes | None = None

    @property
    def in_mm(self) -> bool:
        """Whether the first second has told that sizes are in mm."""
        return self._eyes is not None and self._eyes.unit == "mm"

    def gaze(self, gaze: Gaze, received_ns: int) -> None:
        """Take a direction of gaze; before it is known which eyes there are it is left out."""
        if self._eyes is not None:
            self._eyes.gaze(gaze, received_ns)

    def pupil(self, pupil: Pupil, received_ns: int) -> None:
        """Take a picture of an eye. Raises DeviceLost where another eye or a model comes after the first second."""
        if self._eyes is not None:
            self._eyes.pupil(pupil, received_ns)
            return
        check_time_goes_on("pictures of eyes", self._first)
        self._first.append((pupil, received_ns))
        if not 0 <= pupil.time_ns - self._first[0][0].time_ns < LISTEN_S * SECOND_NS:
            self._eyes = Eyes([pupil for pupil, _ in self._first])
            for each, came_ns in self._first:
                self._eyes.pupil(each, came_ns)

    def items(self) -> Iterator[Item]:
        """Yield what is ready: new declarations, the clock as a new stream needs it, samples."""
        streams = self._eyes.streams if self._eyes else ()
        for declared in self._known.news(streams):
            yield declared
            if self.measured is not None:
                yield self.measured
        for each in streams:
            yield from each.samples()

    def rest(self) -> Iterator[Item]:
        """Yield what is ready, and what waits for more, of a Capture that is gone."""
        try:
            if self._eyes is not None:
                self._eyes.rest()
        except FrameError as err:
            yield err
        yield from self.items()


class Eyes:
    """The eyes whose cameras run, and what is measured of them: decided once, from the first second of pictures."""

    def __init__(self, first: list[Pupil]) -> None:
        self.unit = "mm" if any(pupil.unit == "mm" for pupil in first) else "px"
        kept = [pupil for pupil in first if pupil.unit == self.unit]
        eyes = frozenset(pupil.eye for pupil in kept)
        rate = max(rate_hz([pupil.time_ns for pupil in kept if pupil.eye == eye]) for eye in eyes)
        period_ns = SECOND_NS / (rate or SLOWEST_HZ)
        self._pairing = Pairing(eyes, period_ns)
        self._in_order = InOrder((WAIT_FRAMES + 2) * period_ns if len(eyes) > 1 else 0.0)
        self._gaze = Rows("eye_tracking", GAZE, irregular=len(eyes) > 1)
        self._sizes = Rows("pupillometry", (self.unit, 0.0, LARGEST[self.unit], BITS, self._pairing.channels))
        self.streams = (self._gaze, self._sizes)

    def gaze(self, gaze: Gaze, received_ns: int) -> None:
        """Take a direction of gaze."""
        for row in self._in_order.push(gaze, received_ns):
            self._gaze.push(row)

    def pupil(self, pupil: Pupil, received_ns: int) -> None:
        """Take a picture of an eye; where there are sizes in mm those in px of the same pictures are left out."""
        if pupil.unit != self.unit:
            if pupil.unit == "mm":
                raise DeviceLost("Pupil Capture has begun to fit its 3d model: beginning again in mm")
            return
        if pupil.eye not in self._pairing.eyes:
            raise DeviceLost(f"the camera of eye {pupil.eye} has begun: beginning again with both")
        for row in self._pairing.push(pupil, received_ns):
            self._sizes.push(row)

    def rest(self) -> None:
        """Let go of what waits to be put in order, or for the other eye."""
        for row in self._in_order.rest():
            self._gaze.push(row)
        for row in self._pairing.rest():
            self._sizes.push(row)
