"""Plays one recording: finds out who listens, says first what late listeners must know, keeps time and order."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from typing import Any

from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sense4hri.cdr import header_ns
from sense4hri.errors import ConfigError, Refusal
from sense4hri.service import Service
from sense4hri.stamps import from_ns

from replay.bag import open_recording
from replay.computed import Computed
from replay.config import Config
from replay.listeners import LOOK_S, Listeners
from replay.outlet import Outlet, process_of, refusal, taken
from replay.pace import Pace
from replay.past import Past, before
from replay.recorded import BagError
from replay.selection import Selection
from replay.status import Played, Status

POLL_S, GIVE_WAY_S = 0.002, 0.02
ACKNOWLEDGE_S = 5.0  # so long a subscriber may take before it is no longer waited for
CLOCK_PERIOD_S = 0.01


class Player:
    """Plays `config.bag` from `start_s` to the end, or until `stop`.

    Raises ConfigError where the recording or the selection cannot be played at all.
    """

    def __init__(self, service: Service[Any], config: Config) -> None:
        self._service, self._config, self._log = service, config, service.log
        try:
            selection = Selection(config.what, config.topics, config.exclude, config.remap)
        except ValueError as err:
            raise ConfigError(str(err)) from err
        try:
            self.recording = open_recording(Path(config.bag), config.only_this_part)
        except BagError as err:
            raise ConfigError(f"parameter 'bag': {err}") from err
        topics = {topic.name: selection.target(topic.name) for topic in self.recording.topics}
        self._targets = {name: target for name, target in topics.items() if target is not None}
        if not self._targets:
            self.recording.close()
            raise ConfigError(f"parameters 'topics', 'exclude' and 'what' leave nothing of {config.bag} to play")
        if config.start_s * 1e9 > self.recording.end_ns - self.recording.start_ns:
            self.recording.close()
            raise ConfigError(f"parameter 'start_s' is {config.start_s:g}, {config.bag} lasts {self.duration_s:.1f} s")
        self.state = "starting"
        self.refused: dict[str, str] = {}
        self.published, self.rounds, self.late_s, self.unheard = 0, 0, 0.0, 0
        self._outlets: dict[str, Outlet] = {}
        self._listeners = Listeners(service, config, self._outlets, lambda: self._stopped)
        self._computed = Computed(service, ())
        self._pace = Pace(config.rate)
        self._newest_ns = self.recording.start_ns
        self._seek_ns: int | None = None
        self._past = Past([], set(), {})
        self._stopped = False
        self._gave_way_s = self._clock_s = self._sent_s = 0.0
        self._clock = service.publisher(Clock, "/clock", QoSProfile(depth=10)) if config.clock else None

    @property
    def duration_s(self) -> float:
        """Length of the recording."""
        return (self.recording.end_ns - self.recording.start_ns) / 1e9

    async def run(self) -> None:
        """Play. Raises BagError where the recording turns out to be damaged; what came before has been played.

        Raises ConfigError where a node that must listen is not there.
        """
        if self.recording.set_back_s:
            self._log.warning(
                f"the host's clock was set back by {self.recording.set_back_s:.1f} s while this was recorded: "
                "what came before and after is played mixed, by its log time"
            )
        try:
            await self._open_outlets()
            await self._listeners.come()
            await self._give_way()
            self.state = "playing"
            next_ns: int | None = self.recording.start_ns + round(self._config.start_s * 1e9)
            while not self._stopped and (next_ns is not None or self._config.loop):
                if next_ns is None:
                    next_ns = self.recording.start_ns
                    self.rounds += 1
                await self._prime(next_ns)
                next_ns = await self._play(next_ns)
            await self._finish()
        finally:
            self.close()

    def close(self) -> None:
        """Leave the graph and close the files."""
        for outlet in self._outlets.values():
            outlet.close()
        self._outlets.clear()
        self._computed.close()
        if self._clock is not None:
            self._service.node.destroy_publisher(self._clock)
            self._clock = None
        self.recording.close()

    def pause(self) -> None:
        """Hold until resume."""
        self._pace.pause(time.monotonic())

    def resume(self) -> None:
        """Go on."""
        self._pace.resume(time.monotonic())

    def seek(self, seconds: float) -> None:
        """Go on at so many s from the first message. Raises Refusal outside of the recording, and after its end."""
        if self.state == "ended":
            raise Refusal("the recording has been played to its end: play it again", "s", 409)
        if not 0 <= seconds <= self.duration_s:
            raise Refusal(f"s is {seconds:g}, must be 0 to {self.duration_s:.3f}", "s")
        self._seek_ns = self.recording.start_ns + round(seconds * 1e9)

    def set_rate(self, rate: float) -> None:
        """Go on at another speed."""
        self._pace.set_rate(rate, time.monotonic(), self._newest_ns)

    def stop(self) -> None:
        """End as if the recording ended here."""
        self._stopped = True

    def status(self) -> Status:
        """How far it is."""
        return Status(
            "paused" if self._pace.paused and self.state == "playing" else self.state,
            str(self.recording.path),
            self._pace.rate,
            round((self._newest_ns - self.recording.start_ns) / 1e9, 3),
            round(self.duration_s, 3),
            self.rounds,
            self.published,
            round(self.late_s, 3),
            self.unheard,
            {one.name: Played(one.published, one.subscribers()) for one in self._outlets.values()},
            self.refused,
        )

    async def _open_outlets(self) -> None:
        """Look at who is there, then publish every topic that nobody else publishes."""
        await self._listeners.unchanged(lambda: tuple(map(str, self._service.node.get_topic_names_and_types())))
        node, given = self._service.node, {} if self._clock is None else {"/clock": "the parameter clock"}
        topics = [] if self._stopped else [topic for topic in self.recording.topics if topic.messages]
        named = [(topic, target) for topic in topics if (target := self._targets.get(topic.name))]
        # asked of all before the first is opened: of another replay that opens at once all are seen, or none
        refusals = [refusal(node, topic, target) for topic, target in named]
        for (topic, target), why in zip(named, refusals, strict=True):
            try:
                if target in given:
                    raise BagError(f"{target} is played already, from {given[target]}")
                if why:
                    raise BagError(why)
                self._outlets[topic.name] = Outlet(node, topic, target)
                given[target] = topic.name
            except BagError as err:
                self._refuse(topic.name, str(err))
        self._demand_something()
        played = {outlet.name for outlet in self._outlets.values()}
        wanted = [name for name in played if name.removesuffix("raw") + "features" not in played]
        self._computed.close()
        self._computed = Computed(self._service, wanted)
        self._log.info(f"{self.recording.path}: {len(self._outlets)} topics, {self.duration_s:.1f} s")

    async def _give_way(self) -> None:
        """Leave to others what they have begun to publish meanwhile.

        Of replays that were begun at once the first by its id waits until the others have left it theirs; one that
        does not was not begun at once, and plays.
        """
        own = b""
        until_s = time.monotonic() + self._config.discovery_timeout_s
        while contested := {name: why for name, one in self._outlets.items() if (why := taken(one.node, one.name, 1))}:
            own = own or process_of(self._service.node)
            late = self._stopped or time.monotonic() > until_s
            for name, why in contested.items():
                if late or not self._outlets[name].precedes(own):
                    self._outlets.pop(name).close()
                    self._refuse(name, why)
            await asyncio.sleep(LOOK_S)
        self._demand_something()

    def _refuse(self, topic: str, why: str) -> None:
        self.refused[topic] = why
        self._log.error(f"NOT PLAYED: {topic}: {why}")

    def _demand_something(self) -> None:
        if not self._outlets and not self._stopped:
            raise BagError(f"nothing of {self.recording.path} can be played")

    async def _prime(self, from_ns: int) -> None:
        """Say what a listener that was there before from_ns would know, and what names sensors and persons.

        Once everybody listens: who is who bears no stamp, and what comes after it must not overtake it.
        """
        standing = {name: outlet.standing for name, outlet in self._outlets.items()}
        topics = [outlet.topic for outlet in self._outlets.values()]
        self._past = await before(self.recording, topics, from_ns, standing, self._interrupted)
        for recorded in self._past.messages:
            self._outlets[recorded.topic.name].publish(recorded.cdr, recorded.log_ns)
            self.published += 1
            await self._heard(self._outlets[recorded.topic.name], everything=True)

    async def _play(self, from_ns: int) -> int | None:
        """Play from there to the end; returns where to go on after a seek."""
        self._pace.begin(from_ns, time.monotonic())
        self._newest_ns = from_ns
        self._computed.begin()
        for recorded in self.recording.messages(self._outlets.keys(), from_ns, held=self._past.held):
            if (recorded.topic.name, recorded.log_ns) in self._past.taken:
                continue
            self._leap(recorded.log_ns)
            if not await self._due(recorded.log_ns):
                break
            outlet = self._outlets[recorded.topic.name]
            await self._heard(outlet)
            while self._computed.behind() and not self._interrupted():
                await asyncio.sleep(POLL_S)
            self.late_s += self._pace.played(recorded.log_ns, time.monotonic())
            self._newest_ns = recorded.log_ns
            self._tell_time(recorded.log_ns)
            outlet.publish(recorded.cdr, recorded.log_ns)
            self._computed.sent(outlet.name, header_ns(recorded.cdr) or recorded.log_ns)
            self.published += 1
            if outlet.latched:
                await self._heard(outlet, everything=True)
        else:
            await self._due(self._newest_ns)  # a pause holds here too, and a seek goes on
        target_ns, self._seek_ns = self._seek_ns, None
        return target_ns

    def _interrupted(self) -> bool:
        """True where a stop or a seek has come."""
        return self._stopped or self._seek_ns is not None

    def _leap(self, log_ns: int) -> None:
        """Leave out a silence that nobody waits for, and say so."""
        skipped_s = self._pace.leap(log_ns, self._newest_ns, time.monotonic())
        if skipped_s:
            self._log.warning(f"{skipped_s:.0f} s in which nothing is played are left out")

    async def _due(self, log_ns: int) -> bool:
        """Wait until a message is due; False where a seek or a stop came first."""
        while True:
            if self._interrupted():
                return False
            now_s = time.monotonic()
            due_s = self._pace.due_s(log_ns)
            if self._pace.rate == 0.0 and self._config.most_per_s and not self._pace.paused:
                due_s = self._sent_s + 1.0 / self._config.most_per_s
            if now_s >= due_s:
                self._sent_s = max(due_s, now_s - GIVE_WAY_S)
                if now_s - self._gave_way_s > GIVE_WAY_S:
                    await asyncio.sleep(0)
                    self._gave_way_s = now_s
                return True
            self._tell_time(log_ns)
            await asyncio.sleep(min(due_s - now_s, CLOCK_PERIOD_S))
            self._gave_way_s = time.monotonic()

    async def _heard(self, outlet: Outlet, everything: bool = False) -> None:
        """Wait until subscribers have caught up, or for ACKNOWLEDGE_S."""
        give_up_s = time.monotonic() + ACKNOWLEDGE_S
        while not outlet.acknowledged() if everything else outlet.full():
            if self._stopped:
                return
            if time.monotonic() > give_up_s:
                self.unheard += 1
                outlet.give_up()
                self._log.warning(f"a subscriber of {outlet.name} does not acknowledge; it may miss messages")
                return
            await asyncio.sleep(POLL_S)

    def _tell_time(self, next_ns: int) -> None:
        now_s = time.monotonic()
        if self._clock is not None and not self._pace.paused and now_s - self._clock_s >= CLOCK_PERIOD_S:
            self._clock_s = now_s
            self._clock.publish(Clock(clock=from_ns(self._pace.told_ns(now_s, self._newest_ns, next_ns))))

    async def _finish(self) -> None:
        """Let subscribers take in what was sent before the publishers leave."""
        self.state = "ended"
        for outlet in self._outlets.values():
            await self._heard(outlet, everything=True)
        until_s = time.monotonic() + self._config.linger_s
        while not self._stopped and time.monotonic() < until_s:
            await asyncio.sleep(0.05)
