"""Records every matching topic from the moment it runs until it is told to stop."""

import asyncio
import os
import sys
import time
from pathlib import Path
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from sense4hri.errors import ConfigError
from sense4hri.patterns import Patterns
from sense4hri.service import Service, run
from sense4hri.session import SessionMember
from sense4hri.stamps import SECOND_NS
from sense4hri_msgs.msg import SessionState

from recorder.bag import Bag, new_directory
from recorder.config import Config
from recorder.topics import Topics

POLL_S, FAST_POLL_S, FAST_POLLS = 0.05, 0.02, 500
SETTLE_S, SETTLE_AT_MOST_S = 0.25, 1.2
TICK_S, QUIET_ROUNDS = 0.02, 5


class Recorder:
    """One recording and what is told about it."""

    def __init__(self, service: Service[Config]) -> None:
        self._service, config = service, service.config
        try:
            directory = new_directory(Path(config.directory), time.time())
            self.bag = Bag(
                directory, config.flush_interval_s, config.compression, os.environ.get("ROS_DISTRO", "jazzy")
            )
            _write_pointer(directory)
        except OSError as err:
            raise ConfigError(
                f"parameter 'directory' is {config.directory!r}: {err.strerror} ({err.filename})"
            ) from err
        self.topics = Topics(service.node, config, self.bag)
        self._alone = ("", 0)  # the session for which all others have finished, and since when
        self._failure = ""
        self._short_of_disk = False
        SessionMember(service, self._may_begin, finish=self._finished, directory=lambda: str(directory.resolve()))
        service.http.route("GET", "/recording", lambda path, body: (200, self.status()))
        service.log.info(f"recording to {directory.resolve()}")

    async def run(self) -> None:
        """Record until stopped, then finish the file with everything that was received by then."""
        service = self._service
        service.every(1.0, self._watch)
        service.ready()
        polls = 0
        while not service.stopped.is_set():
            self.topics.poll()
            polls += 1
            await asyncio.sleep(FAST_POLL_S if polls < FAST_POLLS else POLL_S)
        await self._settle()
        self.topics.close()
        self.bag.close()
        counts, lost = self.bag.counts, self.lost()
        if counts.failure:
            service.log.error(f"the recording is not whole: {counts.failure}")
        service.log.info(f"{counts.messages} messages, {lost} lost, in {self.bag.directory.resolve()}")

    def lost(self) -> int:
        """Messages that were sent while recording but are not in the file."""
        return self.bag.counts.lost + sum(topic.losses.lost for topic in self.topics.recorded.values())

    def status(self) -> dict[str, Any]:
        """What `GET /recording` answers."""
        counts = self.bag.counts
        reasons = [counts.failure] if counts.failure else []
        reasons += [f"{refused.topic}: {refused.why}" for refused in self.topics.refused.values()]
        return {
            "directory": str(self.bag.directory.resolve()),
            "recording": not counts.failure,
            "messages": counts.messages,
            "lost": self.lost(),
            "topics": [
                {
                    "topic": topic.channel.topic,
                    "type": topic.channel.type_name,
                    "messages": topic.received,
                    "lost": topic.losses.lost,
                    "missed_at_start": topic.losses.missed,
                }
                for topic in self.topics.recorded.values()
            ],
            "withheld": sorted(self.topics.withheld),
            "reasons": reasons,
        }

    async def _settle(self) -> None:
        """Wait until the ROS thread has handed over what had arrived before the stop.

        A timer on that thread tells that it has been round all its subscriptions, however busy the machine is.
        """
        rounds = 0

        def went_round() -> None:
            nonlocal rounds
            rounds += 1

        timer = self._service.node.create_timer(TICK_S, went_round, clock=Clock(clock_type=ClockType.STEADY_TIME))
        begun, quiet_from, seen = time.monotonic(), 0, self._received()
        while time.monotonic() - begun < SETTLE_AT_MOST_S:
            await asyncio.sleep(TICK_S)
            received = self._received()
            if received != seen:
                quiet_from, seen = rounds, received
            if time.monotonic() - begun > SETTLE_S and rounds - quiet_from > QUIET_ROUNDS:
                break
        self._service.node.destroy_timer(timer)

    def _received(self) -> int:
        return sum(topic.received for topic in self.topics.recorded.values())

    def _watch(self) -> None:
        """Once a second: metrics, and each trouble said once."""
        counts, log, gauge = self.bag.counts, self._service.log, self._service.metrics.gauge
        free = self.bag.free_bytes()
        gauge("recorder_written_messages", "Messages in the file.").set(counts.messages)
        gauge("recorder_written_bytes", "Payload in the file.").set(counts.payload_bytes)
        gauge("recorder_lost_messages", "Messages sent while recording that are not in the file.").set(self.lost())
        gauge("recorder_refused_topics", "Topics whose type is not installed.").set(len(self.topics.refused))
        gauge("recorder_topics", "Topics in the file.").set(len(self.topics.recorded))
        gauge("recorder_disk_free_bytes", "Free space of the disk.").set(free)
        if counts.refused and counts.failure != self._failure:
            log.error(f"NOT RECORDING: {counts.refused}; what was written before is safe, the rest is being lost")
        elif counts.unsafe and counts.failure != self._failure:
            log.error(f"recording, but not safely: {counts.unsafe}")
        elif self._failure and not counts.failure:
            log.info(f"recording again, {counts.lost} messages were lost")
        self._failure = counts.failure
        self._service.ready(not counts.failure)
        short = free < self._service.config.warn_free_mb * 1_000_000
        if short and not self._short_of_disk:
            log.warning(f"{free / 1e6:.0f} MB left on the disk of {self.bag.directory}")
        self._short_of_disk = short

    def _may_begin(self, session: SessionState) -> tuple[bool, str]:
        """Say whether a session may begin: the file is open, and what it requires is being heard."""
        if self.bag.counts.failure:
            return False, self.bag.counts.failure
        required = Patterns(session.required_streams)
        refused = [r for r in self.topics.refused.values() if required.match(r.topic)]
        if refused:
            return False, f"{refused[0].topic}: {refused[0].why}"
        deaf = self.topics.unmatched()
        return not deaf, f"not connected yet to {', '.join(deaf)}" if deaf else ""

    def _finished(self, session: SessionState) -> tuple[bool, str]:
        """Say whether all of a session is on the disk; after everybody else, whose last messages are its end."""
        others = [entry for entry in session.waiting_for if entry.partition(":")[0] != self._service.node.get_name()]
        if others:
            return False, "waits for the others"
        if self._alone[0] != session.session_id:
            self._alone = session.session_id, time.time_ns()
        if self.bag.synced_ns < self._alone[1] + round(SETTLE_S * SECOND_NS):
            return False, "writing"
        return not self.bag.counts.failure, self.bag.counts.failure


def _write_pointer(directory: Path) -> None:
    """`recording` beside the recordings names the newest one."""
    temporary = directory.parent / ".recording"
    temporary.write_text(directory.name + "\n", "utf-8")
    temporary.replace(directory.parent / "recording")


async def serve(service: Service[Config]) -> None:
    """Record until told to stop."""
    await Recorder(service).run()


def main() -> int:
    """Run until stopped."""
    return run("recorder", Config, serve)


if __name__ == "__main__":
    sys.exit(main())
