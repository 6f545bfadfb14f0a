"""The bench's HTTP interface: what may be asked, and what becomes of it."""

import asyncio
import logging
from collections.abc import Callable, Coroutine, Mapping
from typing import Any

from sense4hri.errors import Refusal
from sense4hri.http import Http

from sensor_bench.bench import Bench, polar_ns
from sensor_bench.clock import UNSET_CLOCK_NS
from sensor_bench.polar.peripheral import Peripheral
from sensor_bench.scene import Face, Scene
from sensor_bench.signals.hearts import Heart
from sensor_bench.truth import Device, Truth, devices, truth
from sensor_bench.wishes import AdapterWish, FaceWish, Knobs, Switched, Turned

log = logging.getLogger(__name__)

LINK = ("latency_s", "jitter_s", "connection_interval_s", "loss")
MOST_FACES = 20


class Api:
    """The routes of the bench; to be called on its event loop."""

    def __init__(self, bench: Bench, scene: Scene, truth_window_s: float) -> None:
        self._bench, self._scene, self._truth_window_s = bench, scene, truth_window_s
        self._tasks: set[asyncio.Task[None]] = set()
        self._adapter_lock = asyncio.Lock()

    def serve(self, http: Http) -> None:
        """Add all routes."""
        http.get("/truth", self._truth, Truth)
        http.get("/devices", self._devices, list[Device])
        http.post("/devices/{sensor}/knobs", self._knobs, Knobs, Turned)
        http.get("/faces", self._faces, dict[str, Face])
        http.post("/faces", self._set_faces, dict[str, FaceWish | float], dict[str, Face])
        http.post("/adapter", self._adapter, AdapterWish, Switched)

    def _truth(self) -> Truth:
        """What really happened: clocks, beats, samples."""
        return truth(self._bench, self._truth_window_s)

    def _devices(self) -> list[Device]:
        """The virtual sensors and where their knobs stand."""
        return devices(self._bench)

    def _faces(self) -> dict[str, Face]:
        """The faces by id."""
        return self._scene.faces

    def _soon(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._on_done)

    def _on_done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if not task.cancelled() and (error := task.exception()) is not None:
            log.error("a knob failed", exc_info=error)

    # --- devices ---------------------------------------------------------------------------------------------------

    def _knobs(self, wish: Knobs, sensor: str) -> Turned:
        """Turn knobs of one sensor; everything is checked before anything is turned."""
        peripheral = self._bench.peripherals.get(sensor)
        if peripheral is None:
            raise Refusal(f"no sensor {sensor[:80]!r}; there are {', '.join(self._bench.peripherals)}", status=404)
        given = _given(wish)
        _check(peripheral, given)
        turns = self._turns(peripheral)
        for name, value in given.items():
            turns[name](value)
        return Turned(sensor, given)

    def _turns(self, peripheral: Peripheral) -> dict[str, Callable[[Any], None]]:
        """Knob name -> what turns it."""
        bench, firmware, radio = self._bench, peripheral.firmware, peripheral.radio
        mac = peripheral.identity.address

        def link(name: str) -> Callable[[Any], None]:
            return lambda value: setattr(radio.quality, name, value)

        return {name: link(name) for name in LINK} | {
            "stall_s": radio.stall,
            "drop": lambda on: self._soon(peripheral.drop_link()) if on else None,
            "down": lambda on: self._soon(peripheral.set_down(on)),
            "contact": lambda on: self._soon(peripheral.set_contact(on)),
            "battery_percent": lambda value: peripheral.set_battery(round(value)),
            "rssi_dbm": lambda value: setattr(peripheral, "rssi_dbm", round(value)),
            "skew_ppm": lambda value: firmware.clock.set_skew(bench.host.now_ns(), value),
            "clock_reset": lambda value: firmware.clock.reset(bench.host.now_ns(), _device_ns(value)),
            "heart_rate_bpm": lambda value: setattr(firmware.body.heart, "heart_rate_bpm", value),
            "abort_connects": lambda value: bench.bluez.links.aborts.update({mac: round(value)}),
            "garbled_frames": lambda value: setattr(firmware, "garbled_frames", round(value)),
            "stop_stream": peripheral.stop_stream,
        }

    # --- adapter and faces -----------------------------------------------------------------------------------------

    def _adapter(self, wish: AdapterWish) -> Switched:
        """Plug the adapter in or out, switch it on or off."""
        wanted = _given(wish)
        self._soon(self._set_adapter(wanted))
        return Switched(wanted)

    async def _set_adapter(self, wanted: dict[str, bool]) -> None:
        async with self._adapter_lock:
            if "present" in wanted:
                await self._bench.bluez.adapter.set_present(wanted["present"])
            if "powered" in wanted:
                await self._bench.bluez.adapter.set_powered(wanted["powered"])

    def _set_faces(self, wish: dict[str, FaceWish | float]) -> dict[str, Face]:
        """Change faces by their id, add unknown ones; `count`: how many are visible."""
        count = wish.pop("count", None)
        if count is not None and not (isinstance(count, float) and 0 <= count <= MOST_FACES):
            raise Refusal(f"count must be a number from 0 to {MOST_FACES}", "count")
        changes = {name: _face(name, change) for name, change in wish.items()}
        self._scene.update(changes)
        if isinstance(count, float):
            self._scene.show(round(count))
        return self._scene.faces


def _given(wish: Any) -> dict[str, Any]:
    """Return what a wish says, without what it leaves as it is."""
    return {name: value for name, value in vars(wish).items() if value is not None}


def _face(name: str, change: FaceWish | float) -> Mapping[str, Any]:
    if not isinstance(change, FaceWish):
        raise Refusal(f"{name[:80]} must be an object", name)
    return _given(change)


def _check(peripheral: Peripheral, given: Mapping[str, Any]) -> None:
    """Refuse what this sensor cannot do now; kinds and ranges are checked already."""
    if "heart_rate_bpm" in given and not isinstance(peripheral.firmware.body.heart, Heart):
        raise Refusal("heart_rate_bpm: this participant's heart is a recording's", "heart_rate_bpm")
    if "clock_reset" in given:
        _device_ns(given["clock_reset"])
    running = peripheral.running_streams()
    if "stop_stream" in given and given["stop_stream"] not in running:
        raise Refusal(f"stop_stream: {given['stop_stream']!r} is not streaming; {running} are", "stop_stream")


def _device_ns(wanted: bool | str) -> int:
    """Return what the clock shall show. Raises Refusal."""
    if wanted is True:
        return UNSET_CLOCK_NS
    if not isinstance(wanted, str):
        raise Refusal("clock_reset is false, must be true, or an ISO date and time", "clock_reset")
    try:
        device_ns = polar_ns(wanted)
    except ValueError as err:
        raise Refusal(f"clock_reset: {err}", "clock_reset") from err
    if device_ns < 0:
        raise Refusal(f"clock_reset: {wanted!r} is before 2000-01-01, where the device's time begins", "clock_reset")
    return device_ns
