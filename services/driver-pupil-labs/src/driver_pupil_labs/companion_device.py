"""Neon and Invisible as the kit sees them: the Companion app at one address."""

import asyncio
import math
from collections.abc import AsyncGenerator, Iterable, Iterator, Mapping
from contextlib import AsyncExitStack, suppress

from sense4hri.arrivals import Arrival, Arrivals, Silence
from sense4hri.device import ClockMeasurement, Declared, Identity, Item, Marked, Reported, Status, Stream
from sense4hri.errors import DeviceLost, FrameError
from sense4hri.modalities import XYZ

from driver_pupil_labs import companion, companion_link, imu
from driver_pupil_labs.companion_link import Came
from driver_pupil_labs.config import SCENES_PX, PupilConfig
from driver_pupil_labs.eyes import Row
from driver_pupil_labs.streams import Known, Rows, Shape

KINDS = ("gaze", "eye_events", "imu")
SILENCE_S = 10.0
ASK_S = 5.0  # between two looks at clock and battery
BITS = 32
LARGEST_MM, LARGEST_LID_MM = 10.0, 20.0


class Companion:
    """A Neon or Invisible with its Companion app, as the kit sees it: `stream` connects and yields until it is gone."""

    def __init__(self, config: PupilConfig, streams: Mapping[str, Stream]) -> None:
        self._config = config
        self._measured: ClockMeasurement | None = None
        self._known = Known()
        self._sending: set[asyncio.Task[None]] = set()

    async def stream(self) -> AsyncGenerator[Item, None]:
        """Ask the app what it has, play gaze, eye events and IMU, and yield until the link is lost: DeviceLost."""
        host, port = self._config.address, self._config.usual_port
        status = await companion_link.status(host, port)
        if "gaze" not in status.sensors:
            raise DeviceLost(f"the Companion app at {host}:{port} has no gaze: no glasses are connected to the phone")
        yield Identity(serial_number=status.serial_number or None)
        arrivals, silence = Arrivals[Came | FrameError](), Silence(["gaze"], SILENCE_S)
        self._known.connected()
        told = Told(*SCENES_PX[self._config.model], self._known)
        async with AsyncExitStack() as links:
            for sensor in (status.sensors[kind] for kind in KINDS if kind in status.sensors):
                await links.enter_async_context(companion_link.playing(sensor, arrivals))
            asking = asyncio.create_task(self._ask())
            links.callback(lambda: asking.cancel())
            while True:
                if asking.done():
                    for item in asking.result():
                        yield item
                    asking = asyncio.create_task(self._ask(ASK_S))
                came = await silence.watch(arrivals.together())
                for kind in {each.kind for _, each in came if isinstance(each, Came) and each.device_ns is not None}:
                    silence.broken_by(kind)
                for item in told.take(came):
                    yield item
                    if isinstance(item, Declared) and self._measured is not None:
                        yield self._measured  # a stream that has just begun needs it too

    async def _ask(self, pause_s: float = 0.0) -> list[Item]:
        """Return battery and clock, after a pause; what is not answered is left out, gaze tells whether all is lost."""
        await asyncio.sleep(pause_s)
        items: list[Item] = []
        with suppress(DeviceLost):
            status = await companion_link.status(self._config.address, self._config.usual_port)
            items.append(Status(battery_percent=status.battery_percent))
            if status.echo_port is not None:
                self._measured = await companion_link.measure(self._config.address, status.echo_port)
                items.append(self._measured)
        return items

    def hear(self, marker: Marked) -> None:
        """Let the app keep a marker of the study as an event, at its time."""
        if self._measured is None or not self._config.send_markers:
            return
        name = f"{marker.name}={marker.value}" if marker.value else marker.name
        task = asyncio.ensure_future(self._send(name, marker.event_ns - self._measured.offset_ns))
        self._sending.add(task)
        task.add_done_callback(self._sending.discard)

    async def _send(self, name: str, device_ns: int) -> None:
        with suppress(DeviceLost):  # a lost link is told by the stream
            await companion_link.send_event(self._config.address, self._config.usual_port, name, device_ns)


class Told:
    """What one connection has told so far: rows on their way out, and whether the glasses are worn.

    width_px, height_px: of the scene camera. known: the streams that are declared.
    """

    def __init__(self, width_px: float, height_px: float, known: Known | None = None) -> None:
        self._known = known or Known()
        channels = ("gaze_x", "gaze_y", "confidence")
        shapes: dict[str, Shape] = {
            "eye_tracking": ("px", 0.0, max(width_px, height_px), BITS, channels),
            "pupillometry": ("mm", 0.0, LARGEST_MM, BITS, ("diameter_left", "diameter_right")),
            "eyelids": ("mm", 0.0, LARGEST_LID_MM, BITS, ("aperture_left", "aperture_right")),
            "accelerometer": ("m/s^2", math.nan, math.nan, BITS, XYZ),
            "gyroscope": ("rad/s", math.nan, math.nan, BITS, XYZ),
            "orientation": ("1", -1.0, 1.0, BITS, ("w", *XYZ)),
        }
        self._rows = {sensor_type: Rows(sensor_type, shape) for sensor_type, shape in shapes.items()}
        self._worn: bool | None = None

    def take(self, together: Iterable[Arrival[Came | FrameError]]) -> Iterator[Item]:
        """Decode what came together; yield what it means. What cannot be decoded is the error that says why."""
        for received_ns, came in together:
            try:
                if isinstance(came, FrameError):
                    raise came
                yield from self._meaning(came, received_ns)
            except FrameError as err:
                yield err
        yield from self._ready()

    def _meaning(self, came: Came, received_ns: int) -> Iterator[Item]:
        if came.kind == "gaze":
            if came.device_ns is not None:  # it has no other time
                row = Row(came.device_ns, received_ns, (), came.lost)
                yield from self._look(companion.decode_gaze(came.octets), row)
            return
        if came.kind == "imu":
            self._motion(imu.decode_motion(came.octets), came.lost, received_ns)
            return
        if came.lost:
            yield FrameError(f"{came.lost} packets of eye events are missing")
        if (happening := companion.decode_event(came.octets)) is not None:
            yield Reported("eye_tracking", received_ns, happening.begin_ns, happening.features)

    def _look(self, look: companion.Look, row: Row) -> Iterator[Item]:
        """Take a look; row: its time and what is missing before it."""
        if look.worn != self._worn:
            self._worn = look.worn
            yield Status(contact=float(look.worn))
        self._rows["eye_tracking"].push(row._replace(values=(look.x, look.y, float(look.worn))))
        if look.sizes_mm is not None:
            self._rows["pupillometry"].push(row._replace(values=look.sizes_mm))
        if look.apertures_mm is not None:
            self._rows["eyelids"].push(row._replace(values=look.apertures_mm))

    def _motion(self, motion: imu.Motion, lost: int, received_ns: int) -> None:
        measured = {
            "accelerometer": motion.acceleration,
            "gyroscope": motion.turn,
            "orientation": motion.orientation,
        }
        for sensor_type, values in measured.items():
            self._rows[sensor_type].push(Row(motion.time_ns, received_ns, values, lost))

    def _ready(self) -> Iterator[Item]:
        rows = self._rows.values()
        yield from self._known.news(rows)
        for each in rows:
            yield from each.samples()
