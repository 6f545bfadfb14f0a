"""The bench's HTTP interface: what may be asked, and what becomes of it."""

import asyncio
import inspect
import logging
from collections.abc import Coroutine, Mapping
from typing import Any

from sense4hri.errors import Refusal
from sense4hri.http import Http
from sense4hri.shapes import read

from sensor_bench.bench import Bench
from sensor_bench.device import Shown
from sensor_bench.scene import Face, Scene
from sensor_bench.truth import Truth, truth
from sensor_bench.wishes import AdapterWish, FaceWish, Switched, Turned

log = logging.getLogger(__name__)

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
        http.get("/devices", self._devices, list[Shown])
        http.post("/devices/{sensor}/knobs", self._knobs, dict[str, Any], Turned)
        http.get("/faces", self._faces, dict[str, Face])
        http.post("/faces", self._set_faces, dict[str, FaceWish | float], dict[str, Face])
        http.post("/adapter", self._adapter, AdapterWish, Switched)

    def _truth(self) -> Truth:
        """What really happened: clocks, beats, samples."""
        return truth(self._bench, self._truth_window_s)

    def _devices(self) -> list[Shown]:
        """The virtual sensors and where their knobs stand."""
        return [device.shown() for device in self._bench.devices.values()]

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

    def _knobs(self, wish: dict[str, Any], sensor: str) -> Turned:
        """Turn knobs of one sensor; everything is checked before anything is turned."""
        device = self._bench.devices.get(sensor)
        if device is None:
            raise Refusal(f"no sensor {sensor[:80]!r}; there are {', '.join(self._bench.devices)}", status=404)
        given = _given(read(device.knobs, wish))
        device.check(given)
        turns = device.turns()
        for name, value in given.items():
            later = turns[name](value)
            if inspect.iscoroutine(later):
                self._soon(later)
        return Turned(sensor, given)

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
