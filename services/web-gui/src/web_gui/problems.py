"""What is wrong with the study, in sentences, with what is being done about it. Pure."""

from collections.abc import Iterator
from itertools import groupby

from sense4hri.beats import AFRESH_S, END_ONE
from sense4hri.stamps import SECOND_NS

from web_gui.model import DRIVER, Study
from web_gui.problem_log import Problem
from web_gui.rules import RULES
from web_gui.services import Services
from web_gui.stream import Stream
from web_gui.stream_problems import of_sensor

MOVING_NS = 6 * SECOND_NS  # for so long the old topics of a sensor that moves may still be seen, or be fresh
RECORDER = "recorder"  # its node


def problems(study: Study, now_ns: int) -> Iterator[Problem]:
    """Yield everything that is wrong with the study at this moment."""
    if study.session.phase == "failed":
        detail = study.session.state.get("detail") or "no detail given"
        yield Problem("session", f"the session failed: {detail}", "error")
    yield from _of_recorder(study, now_ns)
    yield from study.hosts.problems(now_ns)
    yield from _of_services(study.services, bool(study.session.recorder.doubt), now_ns)
    for driver, why in study.unseen(now_ns).items():
        text = f"{driver} has found no sensor yet: {why}; is it on, worn and near?"
        yield Problem.of("SensorNotFound", f"lost {driver}", text)
    yield from (Problem(f"fault {topic}", text, "warning") for topic, text in study.faults.items())
    for sensor_id, texts in study.notes.items():
        for which, text in enumerate(texts):
            yield Problem(f"note {sensor_id} {which}", f"{sensor_id}: {text}", "error")
    there = _there(study, now_ns)
    by_sensor = sorted(there, key=_sensor_key)
    for (human_id, sensor_id), streams in groupby(by_sensor, key=_sensor_key):
        yield from of_sensor(study, human_id, sensor_id, list(streams), now_ns)
    yield from _twins(study.services, now_ns)
    yield from _duplicates(there, now_ns)
    yield from _late(study, now_ns)


def _of_recorder(study: Study, now_ns: int) -> Iterator[Problem]:
    recorder, status = study.session.recorder, study.session.recorder.newest(now_ns)
    if recorder.doubt:
        yield Problem.of("RecorderCannotRecord", "not recorded", recorder.doubt)
        return
    if status is None:
        return
    doubts = status.besides if status.level == "warning" else ""  # what was lost before, the bar counts
    left_s = None if status.minutes_left is None else 60 * status.minutes_left
    filling = RULES["DiskFilling"].broken(left_s)
    if filling and not doubts and status.level != "error":
        text = f"recorder: the disk lasts {status.minutes_left:.0f} more minutes; make room, or stop before that"
        yield Problem.of("DiskFilling", "disk", text)
    lost = recorder.lost.lately(now_ns)
    if RULES["MessagesLost"].broken(lost):
        of = f"; in all {status.lost_of}" if status.lost_of else ""
        yield Problem.of("MessagesLost", "recorder lost", f"recorder: {lost:.0f} messages lost within a minute{of}")
    if RULES["RecorderBehind"].broken(status.behind_s):
        text = f"recorder: it takes messages in {status.behind_s:.0f} s late; this machine is too busy"
        yield Problem.of("RecorderBehind", "recorder behind", text)
    if status.level == "error":
        yield Problem.of("RecorderCannotRecord", "recorder", f"recorder: {status.message}")
    elif doubts:  # which name the disk as well
        yield Problem("recorder", f"recorder: {doubts}", "warning", "DiskFilling" if filling else "")


def _of_services(services: Services, doubted: bool, now_ns: int) -> Iterator[Problem]:
    """Yield who hangs, was killed, is not ready or drops messages. doubted: more is known of the recorder already."""
    for service, why in services.troubles(now_ns).items():
        if not (service == RECORDER and doubted):
            hangs = service in services.answering(now_ns)
            alert = "ServiceUnanswering" if hangs else "ServiceDown"
            yield Problem.of(alert, f"service {service}", f"{service}: {why}")
    for service in services.afresh(now_ns):
        text = f"{service} was killed or failed, and was started afresh less than {AFRESH_S:g} s ago"
        yield Problem.of("ServiceRestarting", f"afresh {service}", text)
    for service, why in services.not_ready(now_ns).items():
        if service != RECORDER and not service.startswith(DRIVER):
            yield Problem.of("ServiceNotReady", f"unready {service}", f"{service} is there and not ready: {why}")
    for service, count in services.dropped(now_ns).items():
        if RULES["MessagesDropped"].broken(count):
            text = f"{service} has fallen behind and dropped {count} messages within a minute; this machine is too busy"
            yield Problem.of("MessagesDropped", f"dropped {service}", text)


def _sensor_key(stream: Stream) -> tuple[str, str]:
    return stream.name.human_id, stream.name.sensor_id


def _there(study: Study, now_ns: int) -> list[Stream]:
    """Return all streams but those whose sensor has changed hands: in a replay the old topics stay, and are silent."""
    elsewhere = {stream.name[1:] for stream in study.streams.values() if _heard(stream, now_ns)}
    return [s for s in study.streams.values() if s.name[1:] not in elsewhere or _heard(s, now_ns)]


def _heard(stream: Stream, now_ns: int) -> bool:
    """True where samples came for no longer ago than a move takes, or than is usual between two."""
    return stream.has_raw and stream.silence_s(now_ns) < max(MOVING_NS / SECOND_NS, stream.patience_s())


def _twins(services: Services, now_ns: int) -> Iterator[Problem]:
    """Yield under which names two nodes live, each of which speaks for both."""
    for service in services.twins(now_ns):
        text = f"two nodes are called {service}, and nobody can tell them apart; {END_ONE}"
        yield Problem(f"twin {service}", text, "error")


def _duplicates(there: list[Stream], now_ns: int) -> Iterator[Problem]:
    """Yield sensors that stream under two names for longer than a move to another one takes."""
    streaming = [s for s in there if s.online and (_heard(s, now_ns) or s.fresh_features(now_ns))]
    settled = [s.name for s in streaming if now_ns - s.since_ns > MOVING_NS]
    online = sorted((name.sensor_type, name.sensor_id, name.human_id) for name in settled)
    for (kind, sensor_id), names in groupby(online, key=lambda name: name[:2]):
        humans = [name[2] for name in names]
        if len(humans) > 1:
            text = f"{sensor_id} ({kind}) streams under {' and '.join(humans)} at once; a sensor_id must be unique"
            yield Problem(f"duplicate {kind} {sensor_id}", text, "error")


def _late(study: Study, now_ns: int) -> Iterator[Problem]:
    """Yield that streams come late, in one sentence: a machine that is too busy delays all of them."""
    if study.axis.replaying(now_ns):
        return
    delays = [(delay_s, stream) for stream in study.streams.values() if (delay_s := stream.delays.p99_s(now_ns))]
    late = [one for one in delays if RULES["LatencyGrowing"].broken(one[0])]
    if late:
        delay_s, worst = max(late, key=lambda one: one[0])
        who = f"{worst.name.human_id} / {worst.name.sensor_id}: {worst.name.sensor_type} comes"
        others = {1: "", 2: ", and one more stream is late"}
        more = others.get(len(late), f", and {len(late) - 1} more streams are late")
        text = f"{who} {delay_s:.1f} s after its receipt{more}: a machine or the network is too busy"
        yield Problem.of("LatencyGrowing", "late streams", text, worst.key)
