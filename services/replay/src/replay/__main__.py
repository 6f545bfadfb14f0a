"""Plays a recording, alone or as told over HTTP, until it ends or is told to stop."""

import asyncio
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from sense4hri.endpoint import parse_json
from sense4hri.errors import ConfigError
from sense4hri.service import Service, run

from replay.cli import ros_arguments
from replay.config import Config
from replay.player import Player
from replay.recorded import BagError

EX_DATA = 65
PLAYABLE = frozenset(field.name for field in fields(Config)) - {"progress"}


class Replay:
    """The service: at most one player at a time, and its HTTP routes."""

    def __init__(self, service: Service[Config]) -> None:
        self._service = service
        self.player: Player | None = None
        self._asked = asyncio.Event()
        route = service.http.route
        route("GET", "/status", lambda path, body: (200, self._status()))
        route("POST", "/play", lambda path, body: self._play(parse_json(body)))
        for name in ("pause", "resume", "stop"):
            route("POST", f"/{name}", lambda path, body: self._tell(path, {}))
        for name in ("seek", "rate"):
            route("POST", f"/{name}", lambda path, body: self._tell(path, parse_json(body)))

    async def run(self) -> None:
        """Play the parameter `bag`, then end; without it play what `POST /play` names until the service is stopped."""
        service = self._service
        if service.config.bag:
            self.player = Player(service, service.config)
        service.start(self._end())
        service.every(1.0, self._show)
        service.ready()
        while not service.stopped.is_set():
            if self.player is not None:
                await self._run(self.player)
            if service.config.bag:
                return
            await self._asked.wait()
            self._asked.clear()

    async def _run(self, player: Player) -> None:
        try:
            await player.run()
        except BagError as err:
            if self._service.config.bag:
                raise
            self._service.log.error(str(err))
        self._show()
        if self._service.config.progress:
            print(file=sys.stderr)
        self._service.log.info(f"{player.published} messages of {player.recording.path} played")
        self.player = None

    async def _end(self) -> None:
        await self._service.stopped.wait()
        self._asked.set()
        if self.player is not None:
            self.player.stop()

    def _status(self) -> dict[str, Any]:
        return {"state": "idle"} if self.player is None else self.player.status()

    def _play(self, wish: dict[str, Any]) -> tuple[int, Any]:
        if self.player is not None:
            return 409, {"error": f"{self.player.recording.path} is being played: POST /stop first"}
        for name in wish.keys() - PLAYABLE:
            raise ValueError(f"{name!r} is not a field; fields are {', '.join(sorted(PLAYABLE))}")
        values = {name: _fitting(name, value, getattr(self._service.config, name)) for name, value in wish.items()}
        try:
            self.player = Player(self._service, replace(self._service.config, **values))
        except ConfigError as err:
            raise ValueError(str(err)) from err
        self._asked.set()
        return 200, self._status()

    def _tell(self, path: str, wish: dict[str, Any]) -> tuple[int, Any]:
        player = self.player
        if player is None:
            return 409, {"error": "nothing is being played"}
        if path == "/pause":
            player.pause()
        elif path == "/resume":
            player.resume()
        elif path == "/stop":
            player.stop()
        elif path == "/seek":
            player.seek(_number(wish, "s"))
        else:
            player.set_rate(Config(rate=_number(wish, "rate")).rate)
        return 200, self._status()

    def _show(self) -> None:
        player, gauge = self.player, self._service.metrics.gauge
        if player is None:
            return
        status = player.status()
        gauge("replay_position_seconds", "Recorded time played, from the first message.").set(status["position_s"])
        gauge("replay_published_messages", "Messages played.").set(player.published)
        gauge("replay_refused_topics", "Topics that are not played.").set(len(player.refused))
        if self._service.config.progress:
            share = 100 * status["position_s"] / max(status["duration_s"], 1e-9)
            print(
                f"\r{status['state']:<8} {share:3.0f} %  {status['position_s']:.1f} of {status['duration_s']:.1f} s"
                f"  {player.published} messages ",
                end="",
                file=sys.stderr,
                flush=True,
            )


def _fitting(name: str, value: Any, like: Any) -> Any:
    """A value of a JSON object as the parameter wants it. Raises ValueError."""
    if isinstance(like, tuple) and isinstance(value, list) and all(isinstance(entry, str) for entry in value):
        return tuple(value)
    if isinstance(like, float) and isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if type(value) is not type(like):
        raise ValueError(f"{name} is {value!r}")
    return str(Path(value)) if name == "bag" else value


def _number(wish: dict[str, Any], name: str) -> float:
    value = wish.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f'the body must be {{"{name}": number}}')
    return float(value)


async def serve(service: Service[Config]) -> None:
    """Play until the end of the recording, or until told to stop."""
    await Replay(service).run()


def main() -> int:
    """Play; return the exit status: 65 where the recording turned out to be damaged, or nothing of it can be played."""
    sys.argv[1:] = ros_arguments(sys.argv[1:])
    try:
        return run("replay", Config, serve)
    except BagError as err:
        print(f"replay: {err}", file=sys.stderr, flush=True)
        return EX_DATA


if __name__ == "__main__":
    sys.exit(main())
