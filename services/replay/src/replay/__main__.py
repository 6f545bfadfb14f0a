"""Plays a recording, alone or as told over HTTP, until it ends or is told to stop."""

import asyncio
import sys
from dataclasses import dataclass, field, fields, make_dataclass, replace
from typing import Any, get_type_hints

from sense4hri.errors import ConfigError, Refusal
from sense4hri.run import run
from sense4hri.schema import parameter
from sense4hri.service import Service

from replay.cli import ros_arguments
from replay.config import Config
from replay.player import Player
from replay.recorded import BagError
from replay.status import Status

EX_DATA = 65


@dataclass(frozen=True)
class SeekWish:
    """Where to go on."""

    s: float = parameter(help="recorded time from the first message", unit="s", low=0)


@dataclass(frozen=True)
class RateWish:
    """How fast to go on."""

    rate: float = parameter(help="speed; 0 = as fast as subscribers keep up")


PlayWish = make_dataclass(
    "PlayWish",
    [
        (one.name, get_type_hints(Config)[one.name] | None, field(default=None, metadata=one.metadata))
        for one in fields(Config)
        if one.name != "progress"
    ],
    frozen=True,
)
PlayWish.__doc__ = "What to play, and how: the service's parameters, each as it is configured unless given."


class Replay:
    """The service: at most one player at a time, and its HTTP routes."""

    def __init__(self, service: Service[Config]) -> None:
        self._service = service
        self.player: Player | None = None
        self._asked = asyncio.Event()
        gauge, http = service.metrics.gauge, service.http
        self._position = gauge("replay_position_seconds", "Recorded time played, from the first message.")
        self._published = gauge("replay_published_messages", "Messages played.")
        self._refused = gauge("replay_refused_topics", "Topics that are not played.")
        http.get("/status", self._status, Status)
        http.post("/play", self._play, PlayWish, Status)
        http.post("/pause", self._pause, None, Status)
        http.post("/resume", self._resume, None, Status)
        http.post("/stop", self._stop, None, Status)
        http.post("/seek", self._seek, SeekWish, Status)
        http.post("/rate", self._rate, RateWish, Status)

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
        except (BagError, ConfigError) as err:
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

    def _status(self) -> Status:
        """What is being played, and how far it is."""
        return Status() if self.player is None else self.player.status()

    def _play(self, wish: Any) -> Status:
        """Play a recording."""
        if self.player is not None:
            raise Refusal(f"{self.player.recording.path} is being played: POST /stop first", status=409)
        values = {name: value for name, value in vars(wish).items() if value is not None}
        try:
            self.player = Player(self._service, replace(self._service.config, **values))
        except ConfigError as err:
            raise Refusal(str(err)) from err
        self._asked.set()
        return self._status()

    def _pause(self) -> Status:
        """Hold on."""
        self._playing().pause()
        return self._status()

    def _resume(self) -> Status:
        """Go on."""
        self._playing().resume()
        return self._status()

    def _stop(self) -> Status:
        """End as if the recording ended here."""
        self._playing().stop()
        return self._status()

    def _seek(self, wish: SeekWish) -> Status:
        """Go to another place of the recording."""
        self._playing().seek(wish.s)
        return self._status()

    def _rate(self, wish: RateWish) -> Status:
        """Play faster or slower."""
        self._playing().set_rate(Config(rate=wish.rate).rate)
        return self._status()

    def _playing(self) -> Player:
        if self.player is None:
            raise Refusal("nothing is being played", status=409)
        return self.player

    def _show(self) -> None:
        player = self.player
        if player is None:
            return
        status = player.status()
        self._position.set(status.position_s)
        self._published.set(player.published)
        self._refused.set(len(player.refused))
        if self._service.config.progress:
            share = 100 * status.position_s / max(status.duration_s, 1e-9)
            print(
                f"\r{status.state:<8} {share:3.0f} %  {status.position_s:.1f} of {status.duration_s:.1f} s"
                f"  {player.published} messages ",
                end="",
                file=sys.stderr,
                flush=True,
            )


async def serve(service: Service[Config]) -> None:
    """Play until the end of the recording, or until told to stop."""
    await Replay(service).run()


def main() -> int:
    """Run until stopped; return the exit status: 65 where the recording is damaged or nothing of it can be played."""
    sys.argv[1:] = ros_arguments(sys.argv[1:])
    try:
        return run("replay", Config, serve)
    except BagError as err:
        print(f"replay: {err}", file=sys.stderr, flush=True)
        return EX_DATA


if __name__ == "__main__":
    sys.exit(main())
