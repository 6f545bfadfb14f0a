"""Listens to a study on the graph and sums up what came: streams, samples, losses, clocks, states."""

import math
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any

import rclpy
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from sense4hri import qos
from sense4hri.clock_model import ros_ns
from sense4hri.errors import Refused
from sense4hri.intake import check
from sense4hri.modalities import MODALITIES
from sense4hri.names import ROOT, StreamName
from sense4hri.ros_thread import RosThread
from sense4hri.stamps import to_ns
from sense4hri.topics import Graph, Topic
from sense4hri_msgs import msg
from sense4hri_msgs.msg import ClockModel, PhysioRaw, StreamHealth, UserState
from study_file import Study

LOOK_S = 0.5
"""How often the graph is looked at."""
KINDS: dict[str, tuple[type, QoSProfile]] = {
    "raw": (PhysioRaw, qos.RAW),
    "health": (StreamHealth, qos.HEALTH),
    "clock": (ClockModel, qos.CLOCK),
}
FEATURES: dict[str, type] = {
    each.sensor_type: getattr(msg, each.message) for each in MODALITIES.values() if each.message
}


@dataclass
class Seen:
    """What came of one stream."""

    raw: int = 0
    samples: int = 0
    device_time: bool = False
    features: int = 0
    clocks: int = 0
    heart_rate_bpm: float = math.nan
    health: StreamHealth | None = None
    clock: ClockModel | None = None


class StudyWatch:
    """A node of its own that follows the graph; `spin` it."""

    def __init__(self) -> None:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node("_demo_watch")  # the underscore: it only looks on, no session waits for it
        self._came: SimpleQueue[Callable[[], None]] = SimpleQueue()  # from the ROS thread, for the one that spins
        self._ros = RosThread(self.node, self._fail, lambda name, why: None)  # a service says what it cannot read
        self._ros.start()
        self._graph = Graph(self.node)
        self._graph.watch([f"{ROOT}/*/*/*/*"], self._follow)
        self._graph.watch([f"{ROOT}/*/state"], self._follow_state)
        self._look_at_s = 0.0
        self._subscribed: set[str] = set()
        self._streams: dict[StreamName, Seen] = {}
        self._states: dict[str, Counter[str]] = {}
        self._latest_state: dict[str, UserState] = {}

    def spin(self, seconds: float) -> None:
        """Wait for so long for what comes and take it in; raises what ended the ROS thread."""
        if time.monotonic() >= self._look_at_s:
            self._look_at_s = time.monotonic() + LOOK_S
            self._graph.look()
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0:
            try:
                self._came.get(timeout=left_s)()
            except Empty:
                return

    def hear(self, kind: type, topic: str, take: Callable[[Any], None], profile: QoSProfile) -> None:
        """Have take(message) called, in `spin`, for every message of a topic that a service would take, too."""

        def came(message: Any) -> None:
            with suppress(Refused):
                check(message)
                self._came.put(partial(take, message))

        self.node.create_subscription(kind, topic, came, profile)

    def close(self) -> None:
        """Leave the graph."""
        self._ros.close()
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _fail(self, err: BaseException) -> None:
        def fail() -> None:
            raise err

        self._came.put(fail)

    def line(self) -> str:
        """Return one line of what flows now."""
        people = []
        for human_id, state in sorted(self._latest_state.items()):
            rate = "–" if math.isnan(state.heart_rate_bpm) else f"{state.heart_rate_bpm:.0f}"
            people.append(f"{human_id} {rate} bpm {state.state}")
        samples = sum(seen.samples for seen in self._streams.values())
        return f"{len(self._streams)} streams, {samples} samples; " + (", ".join(people) or "no state yet")

    def summary(self, truth: dict[str, Any], recording: dict[str, Any]) -> str:
        """Return the table of everything seen, the clock errors against the bench's truth beside."""
        rows = [f"{'stream':<40}{'samples':>9}{'lost':>6}{'gaps':>6}{'features':>10}{'bpm':>8}{'clock error':>20}"]
        for name, seen in sorted(self._streams.items()):
            health = seen.health  # a stream that is computed from another one has none, and no samples either
            lost, gaps = (health.lost_samples_total, health.gaps_total) if health else (-1, -1)  # -1: not known
            lost, gaps = ("–" if count < 0 else count for count in (lost, gaps))
            samples = seen.samples if seen.raw else "–"
            rate = "–" if math.isnan(seen.heart_rate_bpm) else f"{seen.heart_rate_bpm:.1f}"
            label = f"{name.human_id}/{name.sensor_type}/{name.sensor_id}"
            device = truth.get("devices", {}).get(name.sensor_id) or {}
            error = clock_error_ms(seen.clock, device)
            shown = "–" if math.isnan(error) else f"{error:+.1f} / {error - smallest_delay_ms(device):+.1f} ms"
            rows.append(f"{label:<40}{samples:>9}{lost:>6}{gaps:>6}{seen.features:>10}{rate:>8}{shown:>20}")
        for human_id, states in sorted(self._states.items()):
            last = self._latest_state[human_id]
            why = f"; at the end {last.state}: {'; '.join(last.reasons)}" if last.reasons else ""
            rows.append(
                f"states of {human_id}: {', '.join(f'{state} {n} s' for state, n in states.most_common())}{why}"
            )
        rows.append(
            "clock error: model minus the bench's truth / less the link's smallest delay, which no one-way link shows;"
            " –: the bench does not know the device's clock"
        )
        if recording:
            rows.append(f"recorded: {recording.get('messages', '?')} messages in {recording.get('directory', '?')}")
        return "\n".join(rows)

    def silent(self, study: Study) -> list[str]:
        """Return a sentence for everything that should have come from this study's services and did not."""
        lines = [f"{each.sensor_id}: no samples" for each in study.sensors if not self._has_samples(each.sensor_id)]
        for name, seen in self._streams.items():
            label = f"{name.sensor_type}/{name.sensor_id}"
            if f"interpreter_{name.sensor_type}" in study.packages and not seen.features:
                lines.append(f"{label}: no features")
            if "clock_sync" in study.packages and seen.device_time and not seen.clocks:
                lines.append(f"{label}: no clock model")
            if seen.raw and seen.health is None:
                lines.append(f"{label}: no health")
        people = {name.human_id for name in self._streams} if "fusion_affect" in study.packages else set()
        lines += [f"{human_id}: no state" for human_id in sorted(people - self._states.keys())]
        return lines

    def _has_samples(self, sensor: str) -> bool:
        return any(seen.samples for name, seen in self._streams.items() if name.sensor_id == sensor)

    def _follow_state(self, topic: Topic) -> None:
        self._subscribe(UserState, topic, self._on_state, qos.STATE)

    def _follow(self, topic: Topic) -> None:
        if (parsed := StreamName.parse(topic.name)) is None:
            return
        name, topic_field = parsed
        seen = self._streams.setdefault(name, Seen())
        if topic_field == "features" and name.sensor_type in FEATURES:
            kind, profile = FEATURES[name.sensor_type], qos.FEATURES
        elif topic_field in KINDS:
            kind, profile = KINDS[topic_field]
        else:
            return

        def take(message: Any) -> None:
            match topic_field:
                case "raw":
                    seen.raw += 1
                    seen.samples += len(message.channels[0].samples) if message.channels else 0
                    seen.device_time = seen.device_time or to_ns(message.device_timestamp) != 0
                case "features":
                    seen.features += 1
                    seen.heart_rate_bpm = getattr(message, "heart_rate_bpm", math.nan)
                case "clock":
                    seen.clocks += 1
                    seen.clock = message
                case "health":
                    seen.health = message

        self._subscribe(kind, topic, take, qos.deep(profile, 500))

    def _subscribe(self, kind: type, topic: Topic, take: Callable[[Any], None], profile: QoSProfile) -> None:
        """Hear a topic from its first publisher on until the end."""
        if topic.publishers and topic.name not in self._subscribed:
            self._subscribed.add(topic.name)
            self.hear(kind, topic.name, take, profile)

    def _on_state(self, message: UserState) -> None:
        self._states.setdefault(message.human_id, Counter())[message.state] += 1
        self._latest_state[message.human_id] = message


def smallest_delay_ms(truth: dict[str, Any]) -> float:
    """Return the part of a device's clock error that nobody can see: NaN where the bench does not say it."""
    return float(truth.get("smallest_delay_s", math.nan)) * 1e3


def clock_error_ms(model: ClockModel | None, truth: dict[str, Any] | None) -> float:
    """Return model minus truth, in ms, now; NaN where one of them is not known.

    truth: the bench's own clock of the device, `reference_host_ns`, `reference_device_ns` and `skew_ppm` (device
    seconds per host second, minus one).
    """
    if model is None or not truth or "reference_host_ns" not in truth:
        return math.nan
    reference_ns = to_ns(model.device_reference)
    elapsed_ns = (reference_ns - truth["reference_device_ns"]) / (1 + truth["skew_ppm"] * 1e-6)
    true_ns = truth["reference_host_ns"] + round(elapsed_ns)
    return (ros_ns(reference_ns, reference_ns, model.offset_ns, model.skew_ppm) - true_ns) / 1e6
