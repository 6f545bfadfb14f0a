"""The bench's HTTP interface: JSON in, (status, JSON) out. Bad input is a ValueError: the kit answers 400."""

import asyncio
import json
import logging
from collections.abc import Callable, Coroutine
from typing import Any, NamedTuple

from sensor_bench import truth
from sensor_bench.bench import Bench, polar_ns
from sensor_bench.clock import UNSET_CLOCK_NS
from sensor_bench.polar.peripheral import Peripheral
from sensor_bench.scene import Scene
from sensor_bench.signals.hearts import Heart

log = logging.getLogger(__name__)

Answer = tuple[int, Any]


class Number(NamedTuple):
    """The range of a numeric knob."""

    low: float
    high: float

    def read(self, name: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{name}: expected a number, got {value!r}")
        if not self.low <= value <= self.high:
            raise ValueError(f"{name}: {value!r} is not within {self.low:g}..{self.high:g}")
        return value


def _flag(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"{name}: expected true or false, got {value!r}")
    return value


def _device_time(name: str, value: str) -> int:
    try:
        device_ns = polar_ns(value)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from error
    if device_ns < 0:
        raise ValueError(f"{name}: {value!r} is before 2000-01-01, where the device's time begins")
    return device_ns


def json_object(body: bytes, known: set[str] | None = None) -> dict[str, Any]:
    """The request's JSON object, with no key outside `known`."""
    try:
        given = json.loads(body)
    except ValueError as error:
        raise ValueError(f"the body is not JSON: {error}") from error
    if not isinstance(given, dict) or not given:
        raise ValueError("the body must be a JSON object with at least one key")
    if known is not None and (unknown := sorted(set(given) - known)):
        raise ValueError(f"unknown key {unknown[0]!r}; known are {', '.join(sorted(known))}")
    return given


LINK = {
    "latency_s": Number(0, 10),
    "jitter_s": Number(0, 5),
    "connection_interval_s": Number(0, 4),
    "loss": Number(0, 1),
}
BATTERY, RSSI, SKEW = Number(0, 100), Number(-127, 20), Number(-10_000, 10_000)
RATE, STALL, COUNT, FACES = Number(25, 240), Number(0, 60), Number(0, 1000), Number(0, 20)


class Api:
    """Handlers for the routes in `routes()`; to be called on the event loop of the bench."""

    def __init__(self, bench: Bench, scene: Scene, truth_window_s: float) -> None:
        self._bench, self._scene, self._truth_window_s = bench, scene, truth_window_s
        self._tasks: set[asyncio.Task[None]] = set()
        self._adapter_lock = asyncio.Lock()

    def routes(self) -> list[tuple[str, str, Callable[[str, bytes], Answer]]]:
        return [
            ("GET", "/truth", self._truth),
            ("GET", "/devices", self._devices),
            ("POST", "/devices/", self._knobs),
            ("GET", "/faces", self._faces),
            ("POST", "/faces", self._set_faces),
            ("POST", "/adapter", self._adapter),
        ]

    def _truth(self, path: str, body: bytes) -> Answer:
        return 200, truth.truth(self._bench, self._truth_window_s)

    def _devices(self, path: str, body: bytes) -> Answer:
        return 200, truth.devices(self._bench)

    def _faces(self, path: str, body: bytes) -> Answer:
        return 200, self._scene.described()

    def _soon(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._on_done)

    def _on_done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("a knob failed", exc_info=error)

    # --- devices ---------------------------------------------------------------------------------------------------

    def _knobs(self, path: str, body: bytes) -> Answer:
        """`/devices/<sensor>/knobs`: everything is checked before anything is turned."""
        parts = path.strip("/").split("/")
        if len(parts) != 3 or parts[2] != "knobs":
            return 404, {"error": f"nothing at {path}; there is /devices/<sensor>/knobs"}
        peripheral = self._bench.peripherals.get(parts[1])
        if peripheral is None:
            return 404, {"error": f"no sensor {parts[1]!r}; there are {', '.join(self._bench.peripherals)}"}
        known = self._turns(peripheral)
        given = json_object(body, set(known))
        for turn in [known[name](name, value) for name, value in given.items()]:
            turn()
        return 200, {"sensor": parts[1], "set": given}

    def _turns(self, peripheral: Peripheral) -> dict[str, Callable[[str, Any], Callable[[], None]]]:
        """Knob name -> a check of its value that returns the turn itself."""
        bench, quality, mac = self._bench, peripheral.radio.quality, peripheral.identity.address

        def number(kind: Number, turn: Callable[[float], None]) -> Callable[[str, Any], Callable[[], None]]:
            def check(name: str, value: Any) -> Callable[[], None]:
                checked = kind.read(name, value)
                return lambda: turn(checked)

            return check

        def flag(turn: Callable[[bool], None]) -> Callable[[str, Any], Callable[[], None]]:
            def check(name: str, value: Any) -> Callable[[], None]:
                checked = _flag(name, value)
                return lambda: turn(checked)

            return check

        def link(name: str) -> Callable[[str, Any], Callable[[], None]]:
            return number(LINK[name], lambda value: setattr(quality, name, float(value)))

        return {name: link(name) for name in LINK} | {
            "stall_s": number(STALL, peripheral.radio.stall),
            "drop": flag(lambda on: self._soon(peripheral.drop_link()) if on else None),
            "down": flag(lambda on: self._soon(peripheral.set_down(on))),
            "contact": flag(lambda on: self._soon(peripheral.set_contact(on))),
            "battery_percent": number(BATTERY, lambda value: peripheral.set_battery(round(value))),
            "rssi_dbm": number(RSSI, lambda value: setattr(peripheral, "rssi_dbm", round(value))),
            "skew_ppm": number(SKEW, lambda value: peripheral.firmware.clock.set_skew(bench.host.now_ns(), value)),
            "clock_reset": self._clock_reset(peripheral),
            "heart_rate_bpm": self._heart_rate(peripheral),
            "abort_connects": number(COUNT, lambda value: bench.bluez.links.aborts.update({mac: round(value)})),
            "garbled_frames": number(COUNT, lambda value: setattr(peripheral.firmware, "garbled_frames", round(value))),
            "stop_stream": self._stop_stream(peripheral),
        }

    def _clock_reset(self, peripheral: Peripheral) -> Callable[[str, Any], Callable[[], None]]:
        def check(name: str, value: Any) -> Callable[[], None]:
            if value is True:
                device_ns = UNSET_CLOCK_NS
            elif isinstance(value, str):
                device_ns = _device_time(name, value)
            else:
                raise ValueError(f"{name}: expected true, or an ISO date and time, got {value!r}")
            return lambda: peripheral.firmware.clock.reset(self._bench.host.now_ns(), device_ns)

        return check

    def _heart_rate(self, peripheral: Peripheral) -> Callable[[str, Any], Callable[[], None]]:
        def check(name: str, value: Any) -> Callable[[], None]:
            heart, rate = peripheral.firmware.body.heart, float(RATE.read(name, value))
            if not isinstance(heart, Heart):
                raise ValueError(f"{name}: this participant's heart is a recording's")
            return lambda: setattr(heart, "heart_rate_bpm", rate)

        return check

    def _stop_stream(self, peripheral: Peripheral) -> Callable[[str, Any], Callable[[], None]]:
        def check(name: str, value: Any) -> Callable[[], None]:
            if not isinstance(value, str) or value not in peripheral.running_streams():
                raise ValueError(f"{name}: {value!r} is not streaming; {peripheral.running_streams()} are")
            return lambda: peripheral.stop_stream(value)

        return check

    # --- adapter and faces -----------------------------------------------------------------------------------------

    def _adapter(self, path: str, body: bytes) -> Answer:
        given = json_object(body, {"present", "powered"})
        wanted = {name: _flag(name, value) for name, value in given.items()}
        self._soon(self._set_adapter(wanted))
        return 200, {"set": wanted}

    async def _set_adapter(self, wanted: dict[str, bool]) -> None:
        async with self._adapter_lock:
            if "present" in wanted:
                await self._bench.bluez.adapter.set_present(wanted["present"])
            if "powered" in wanted:
                await self._bench.bluez.adapter.set_powered(wanted["powered"])

    def _set_faces(self, path: str, body: bytes) -> Answer:
        given = json_object(body)
        count = given.pop("count", None)
        self._scene.update(given)
        if count is not None:
            self._scene.show(round(FACES.read("count", count)))
        return 200, self._scene.described()
