"""replay as a process: real recordings against references, refusals, control over HTTP."""

import asyncio
import re
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from threading import Barrier
from types import SimpleNamespace
from typing import Any

import pytest
from ears import Ears
from hostile import mcap_bytes
from mcap.reader import SeekingReader
from mcap.writer import Writer
from processes import DEADLINE_S, Process, claimed_domain, poll
from rcl_interfaces.srv import ListParameters
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from replay.bag import open_recording
from replay.config import Config
from replay.outlet import Outlet, refusal, taken
from replay.past import Past, before
from replay.player import Player
from rosgraph_msgs.msg import Clock
from sense4hri.stamps import to_ns
from std_msgs.msg import String

sys.path.insert(0, str(Path(__file__).parent))
from replay_references import changes, results, stored

REAL = Path(__file__).resolve().parents[3] / "shared" / "data"
STRING = "string data\n"
SECOND_NS = 1_000_000_000
START_NS = 1_700_000_000 * SECOND_NS
LATCHED = "- {reliability: reliable, durability: transient_local, history: keep_last, depth: 1}"
RELIABLE = "- {reliability: reliable, durability: volatile, history: keep_last, depth: 10}"


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """20 s of /count at 10 Hz, a /said that late listeners are told, and /unknown of a type nobody has."""
    path = tmp_path / "bag.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1000)
        writer.start(profile="ros2")
        string = writer.register_schema("std_msgs/msg/String", "ros2msg", STRING.encode())
        other = writer.register_schema("nobody_msgs/msg/Has", "ros2msg", STRING.encode())
        count = writer.register_channel("/count", "cdr", string, {"offered_qos_profiles": RELIABLE})
        said = writer.register_channel("/said", "cdr", string, {"offered_qos_profiles": LATCHED})
        unknown = writer.register_channel("/unknown", "cdr", other, {})
        for i in range(200):
            stamp = START_NS + i * SECOND_NS // 10
            if i % 50 == 0:
                writer.add_message(said, stamp, serialize_message(String(data=f"said {i}")), stamp)
                writer.add_message(unknown, stamp, serialize_message(String()), stamp)
            writer.add_message(count, stamp, serialize_message(String(data=str(i))), stamp)
        writer.finish()
    return path


class Heard(Ears):
    """What came on /count and /said, in order."""

    def __init__(self) -> None:
        super().__init__("heard")
        self.count: list[int] = []
        self.said: list[str] = []
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(String, "/count", lambda m: self.count.append(int(m.data)), 1000)
        self.node.create_subscription(String, "/said", lambda m: self.said.append(m.data), latched)


@pytest.fixture
def heard(opened) -> Heard:
    return opened(Heard())


def test_everything_arrives_once_and_in_order(heard, start, bag):
    """As fast as the subscriber keeps up, every message arrives once, in order; an unknown type is refused by name."""
    replay = start("replay", bag=bag, rate=0.0, linger_s=0.0)
    heard.until(lambda: heard.count and heard.count[-1] == 199, lambda: f"the last message: {heard.count[-3:]}")
    heard.until(lambda: heard.said == [f"said {i}" for i in (0, 50, 100, 150)], lambda: f"all of {heard.said}")
    assert replay.wait() == 0
    assert heard.count == list(range(200))
    assert "NOT PLAYED: /unknown: its type nobody_msgs/msg/Has is not installed" in replay.log()


def test_what_had_been_said_before_the_start_is_said_to_who_listens(opened, start, bag):
    """Not before who subscribes to what it finds is connected, even one that asks for no old messages."""
    ears = opened(Ears("finder"))
    start("replay", bag=bag, rate=0.0, start_s=19.05)
    ears.until(lambda: ears.node.count_publishers("/said"), "the topic is there")
    said = ears.hear(String, "/said", QoSProfile(depth=10))
    count = ears.hear(String, "/count", QoSProfile(depth=1000))
    ears.until(lambda: count and count[-1].data == "199", "the end")
    assert [m.data for m in said] == ["said 150"]
    assert [m.data for m in count] == [str(i) for i in range(191, 200)]


def test_what_was_received_at_one_moment_is_all_played(opened, start, bag):
    """Two of /tf_static with one log time, as a converted recording has them, are both said."""
    told = mcap_bytes.read(bag)
    still = [replace(told[0], topic="/tf_static", data=serialize_message(String(data=name))) for name in "ab"]
    mcap_bytes.write(bag, [*told, *still])
    ears = opened(Ears("frames"))
    latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    said = ears.hear(String, "/tf_static", latched)
    assert start("replay", bag=bag, rate=0.0, linger_s=0.0).wait() == 0
    ears.until(lambda: len(said) == 2, lambda: f"both of {said}", 5.0)
    assert [m.data for m in said] == ["a", "b"]


def listening(replay: Process) -> int:
    """How many hear /count, 0 as long as it is not there."""
    status, told = replay.ask("/status")
    return told["topics"].get("/count", {"subscribers": 0})["subscribers"] if status == 200 else 0


def test_nothing_is_played_before_who_is_waited_for(heard, opened, start, bag):
    """Somebody who listens does not make it begin; whoever comes last has missed nothing."""
    replay = start("replay", bag=bag, rate=0.0, linger_s=0.0, wait_for=["late"], discovery_s=0.5)
    heard.until(lambda: listening(replay), "somebody listens")
    looked_s = time.monotonic()
    heard.until(lambda: time.monotonic() - looked_s > 2.0, "four times what is waited where nobody is named")
    assert heard.count == []
    late = opened(Ears("late"))
    count = late.hear(String, "/count", QoSProfile(depth=1000))
    late.until(lambda: count and count[-1].data == "199", "the end")
    assert [m.data for m in count] == [str(i) for i in range(200)]
    assert replay.wait() == 0


def test_who_is_waited_for_in_vain_is_named(start, bag):
    """Status 78 and one line; nothing is played."""
    replay = start("replay", bag=bag, wait_for=["nobody", "lab/no_one"], discovery_timeout_s=0.5)
    assert replay.wait() == 78
    said = "replay: configuration: parameter 'wait_for': after 0.5 s there is no node nobody, no lab/no_one"
    assert replay.log().strip().splitlines()[-1] == said
    assert "played" not in replay.log()


def test_a_name_that_no_topic_can_have_here_is_refused(heard, start, bag):
    """As tools that know no ROS 2 write them; the rest is played."""
    told, names = mcap_bytes.read(bag), ["/9x", "/a-b", "/a b", "/a//b", "/x/", "/~x", "/{x}", "/" + 300 * "a"]
    mcap_bytes.write(bag, [*told, *(replace(told[0], topic=name) for name in names)])
    replay = start("replay", bag=bag, rate=0.0, linger_s=0.0)
    assert replay.wait() == 0
    heard.until(lambda: heard.count == list(range(200)), "the rest")
    assert [name for name in names if f"NOT PLAYED: {name}: it is no name of a topic" not in replay.log()] == []


def test_a_recording_brings_no_code(heard, start, bag, monkeypatch):
    """Begun in a recording's folder, a message package in it, replay plays the rest and runs none of that."""
    mark, package = bag.with_name("was run"), bag.with_name("hostile_package")
    definition = bag.parent / "share" / "hostile_package" / "msg" / "Evil.msg"
    for folder in (package, definition.parent):
        folder.mkdir(parents=True)
    for name in ("__init__.py", "msg.py"):
        (package / name).write_text(f"import pathlib\npathlib.Path({str(mark)!r}).touch()\nclass Evil: pass\n")
    definition.write_text(STRING)
    told = mcap_bytes.read(bag)
    evil = replace(told[0], topic="/evil", type_name="hostile_package/msg/Evil")
    mcap_bytes.write(bag, [*told, evil])
    monkeypatch.chdir(bag.parent)
    replay = start("replay", bag=bag, rate=0.0, linger_s=0.0)
    heard.until(lambda: heard.count and heard.count[-1] == 199, lambda: f"the last message: {heard.count[-3:]}")
    assert replay.wait() == 0
    assert "NOT PLAYED: /evil: its type hostile_package/msg/Evil is not installed" in replay.log()
    assert not mark.exists()


def test_pause_seek_and_stop_over_http(heard, start, bag):
    """A seek while paused goes on there after resuming, and says what had been said before that place."""
    replay = start("replay", bag=bag, rate=0.5, linger_s=0.0)  # 20 s until what must not have come at the seek
    heard.until(lambda: len(heard.count) > 3, "playing")
    assert replay.ask("/pause", {})[1]["state"] == "paused"
    assert replay.ask("/seek", {"s": 99})[0] == 400
    assert replay.ask("/seek", {"s": 12.05})[0] == 200
    assert replay.ask("/rate", {"rate": 20})[1]["rate"] == 20
    assert replay.ask("/play", {"bag": str(bag)})[0] == 409
    assert heard.count[-1] < 100
    assert replay.ask("/resume", {})[0] == 200
    heard.until(lambda: heard.count[-1] > 130 and "said 100" in heard.said, "what comes, and holds, after the seek")
    assert replay.ask("/stop", {})[0] == 200
    assert replay.wait() == 0
    skipped = [b for a, b in pairwise(heard.count) if b != a + 1]
    assert skipped == [121]


def test_a_seek_says_again_only_what_no_longer_holds(heard, start, bag):
    """What listeners hold already comes once; back before it, what held there comes again."""
    replay = start("replay", bag=bag, rate=1.0, linger_s=0.0)
    heard.until(lambda: len(heard.count) > 3, "playing")
    for place_s in (3.0, 1.0):
        assert replay.ask("/seek", {"s": place_s})[0] == 200
        heard.until(lambda place_s=place_s: heard.count[-1] == 10 * place_s + 2, "what comes after the seek")
    assert heard.said == ["said 0"]
    for place_s in (6.0, 2.0):
        assert replay.ask("/seek", {"s": place_s})[0] == 200
        heard.until(lambda place_s=place_s: heard.count[-1] == 10 * place_s + 2, "what comes after the seek")
    assert heard.said == ["said 0", "said 50", "said 0"]


def test_a_seek_in_a_recording_of_several_files_says_a_state_once(heard, start, bag):
    """What each further file repeats at its head is not said again, wherever playing began."""
    folder, told = bag.parent / "several", [each for each in mcap_bytes.read(bag) if each.topic != "/unknown"]
    folder.mkdir()
    state = next(each for each in told if each.topic == "/said")
    for number in range(4):
        begins_ns = START_NS + number * 5 * SECOND_NS
        own = [each for each in told if each.topic == "/count" and 0 <= each.log_ns - begins_ns < 5 * SECOND_NS]
        head = replace(state, log_ns=begins_ns - SECOND_NS // 2 if number else begins_ns, sequence=0)
        mcap_bytes.write(folder / f"several_{number}.mcap", [head, *own])
    replay = start("replay", bag=folder, linger_s=0.0)
    heard.until(lambda: len(heard.count) > 3, "playing")
    assert replay.ask("/seek", {"s": 7})[0] == 200
    assert replay.ask("/rate", {"rate": 20})[0] == 200
    assert replay.wait() == 0
    heard.until(lambda: heard.count[-1] == 199, "the end")
    assert heard.said == ["said 0"]


def test_a_pause_holds_where_nothing_more_is_to_be_played(heard, start, bag):
    """Sought to a place after the last message it is paused, not ended, and goes where it is sought to next."""
    replay = start("replay", bag=bag, topics=["/said"], linger_s=0.0)
    heard.until(lambda: heard.said, "playing")
    assert replay.ask("/pause", {})[0] == 200
    assert replay.ask("/seek", {"s": 18})[0] == 200
    heard.until(lambda: heard.said == ["said 0", "said 150"], "what holds there")
    poll(lambda: replay.ask("/status")[1]["position_s"] == 18.0, "the place")
    assert replay.ask("/status")[1]["state"] == "paused"
    assert replay.ask("/seek", {"s": 9})[0] == 200
    heard.until(lambda: heard.said[2:] == ["said 50"], "what holds at the other place")
    assert replay.ask("/resume", {})[0] == 200
    assert replay.ask("/rate", {"rate": 20})[0] == 200
    assert replay.wait() == 0
    heard.until(lambda: heard.said[3:] == ["said 100", "said 150"], "the rest")


def test_what_had_been_said_is_not_looked_for_in_vain(bag):
    """A stop, or another seek, does not wait until a long recording has been read for what held at a place of it."""
    recording, looks = open_recording(bag), iter([False, True])
    topics = [topic for topic in recording.topics if topic.name == "/said"]
    past = before(recording, topics, recording.end_ns, {"/said": []}, lambda: next(looks))
    assert asyncio.run(past) == Past([], set(), {})
    recording.close()


def test_a_recording_that_has_been_played_watches_the_graph_no_more(heard, bag):
    """However many are played one after the other, for each watch that was begun one has ended."""
    watches: list[object] = []
    service = SimpleNamespace(
        node=heard.node,
        log=heard.node.get_logger(),
        watch=lambda *what: watches.append(what) or what,
        graph=SimpleNamespace(unwatch=watches.remove),
    )
    player = Player(service, Config(bag=str(bag), rate=0.0, linger_s=0.0, discovery_timeout_s=0.0))
    asyncio.run(player.run())
    assert player.published
    assert watches == []


def test_it_waits_for_a_bag_and_refuses_nonsense_and_what_somebody_publishes(heard, start, bag, tmp_path):
    """POST /play starts a bag, wrong wishes are answered with 400; a topic goes elsewhere, or not where one is live."""
    told = heard.hear(String, "/told", QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    replay = start("replay", linger_s=0.0)
    poll(lambda: replay.get("/readyz")[0] == 200, "ready")
    assert replay.ask("/status")[1]["state"] == "idle"
    assert replay.ask("/pause", {})[0] == 409
    assert "speed" in replay.ask("/play", {"bag": str(bag), "speed": 2})[1]["error"]
    assert "there is no such file" in replay.ask("/play", {"bag": str(tmp_path / "none")})[1]["error"]
    assert replay.ask("/play", {"bag": str(bag), "rate": 0, "remap": ["/said:=/told"]})[0] == 200
    heard.until(lambda: heard.count and heard.count[-1] == 199, "the last message")
    heard.until(lambda: [m.data for m in told] == [f"said {i}" for i in (0, 50, 100, 150)], "what was said, elsewhere")
    assert heard.said == []
    poll(lambda: replay.ask("/status")[1]["state"] == "idle", "idle again")
    live = heard.node.create_publisher(String, "/count", 10)
    heard.ask(ListParameters, "/replay/list_parameters", ListParameters.Request())  # who answers has seen `live` too
    assert replay.ask("/play", {"bag": str(bag), "start_s": 9.9, "rate": 0.1})[0] == 200
    heard.until(lambda: "said 100" in heard.said, "the other topic, 50 s before its next message")
    assert "published already, by /heard" in replay.ask("/status")[1]["refused"]["/count"]
    assert replay.ask("/stop", {})[0] == 200
    assert heard.count == list(range(200))
    heard.node.destroy_publisher(live)


def test_what_somebody_begins_to_publish_before_the_first_message_is_left_to_them(heard, opened, start, bag):
    """A driver, or another replay, that begins while listeners are waited for is seen: nothing is mixed."""
    replay = start("replay", bag=bag, rate=0.0, linger_s=0.0, wait_for=["late"])
    replay.until("2 topics")
    live = heard.node.create_publisher(String, "/count", 10)
    late = opened(Ears("late", beside=heard))
    late.hear(String, "/said", QoSProfile(depth=10))
    heard.until(lambda: heard.said == [f"said {i}" for i in (0, 50, 100, 150)], "the other topic")
    assert replay.wait() == 0
    assert heard.count == []
    assert "NOT PLAYED: /count: it is published already, by /heard" in replay.log()
    heard.node.destroy_publisher(live)


def player(node: Node, bag: Path, **parameters: Any) -> Player:
    """A player in this process."""
    graph = SimpleNamespace(unwatch=lambda what: None)
    service = SimpleNamespace(node=node, log=node.get_logger(), watch=lambda *what: what, graph=graph)
    return Player(service, Config(bag=str(bag), rate=0.0, linger_s=0.0, **parameters))


def test_who_publishes_is_asked_of_all_topics_before_the_first_is_opened(heard, bag, monkeypatch):
    """Two replays that open at once would share a recording out between them: each has the topics it opened first."""
    done: list[str] = []
    for name, function in {"Outlet": Outlet, "refusal": refusal}.items():
        noted = lambda *given, name=name, function=function: (done.append(name), function(*given))[1]  # noqa: E731
        monkeypatch.setattr(f"replay.player.{name}", noted)
    asyncio.run(player(heard.node, bag, discovery_timeout_s=0.0).run())
    assert done == ["refusal"] * 3 + ["Outlet"] * 2


def test_of_two_replays_begun_at_once_exactly_one_stays(heard, opened, bag, monkeypatch):
    """Neither sees the other begin, and both see both before either acts: one plays all, the other says why not."""
    seen, together = set(), Barrier(2, timeout=DEADLINE_S)

    def at_once(node: Node, name: str, own: int = 0) -> str:
        why = taken(node, name, own) if own else ""
        if own and (node, name) not in seen:
            seen.add((node, name))
            together.wait()
        return why

    for module in ("outlet", "player"):
        monkeypatch.setattr(f"replay.{module}.taken", at_once)
    players = [player(opened(Ears("replay")).node, bag, wait_for=("heard",)) for _ in range(2)]
    with ThreadPoolExecutor() as threads:
        runs = [threads.submit(asyncio.run, one.run()) for one in players]
        heard.until(lambda: all(run.done() for run in runs), "the end of both")
    ended = {str(run.exception() or ""): one for run, one in zip(runs, players, strict=True)}
    assert ended.keys() == {"", f"nothing of {bag} can be played"}
    assert ended.pop("").refused.keys() == {"/unknown"}
    (left,) = ended.values()
    assert "published already, by /replay" in left.refused["/count"]
    heard.until(lambda: heard.count == list(range(200)), lambda: f"all of {heard.count}")


@pytest.mark.parametrize(("parameter", "value"), [("bag", "/none"), ("start_s", 1000.0)])
def test_a_wrong_parameter_is_named(start, bag, parameter, value):
    """Status 78 and one line with the parameter's name."""
    replay = start("replay", **{"bag": bag, parameter: value})
    assert replay.wait() == 78
    last = replay.log().strip().splitlines()[-1]
    assert last.startswith("replay: configuration: ")
    assert f"'{parameter}'" in last


def test_what_turns_out_to_be_damaged_ends_with_a_sentence(start, bag):
    """Up to the damaged chunk it is played; then status 65, one line that names the file, and no traceback."""
    data = bytearray(bag.read_bytes())
    with bag.open("rb") as file:
        chunk = SeekingReader(file).get_summary().chunk_indexes[3]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    bag.write_bytes(data)
    replay = start("replay", bag=bag, rate=0.0, linger_s=0.0, discovery_timeout_s=0.0)
    assert replay.wait() == 65
    assert re.search(rf"^replay: {bag} is damaged", replay.log(), re.MULTILINE)
    assert "Traceback" not in replay.log()


def test_a_loop_and_its_clock(heard, start, bag):
    """A loop says everything again in order, latched topics too; /clock follows the recorded time, and goes back."""
    ticks = heard.hear(Clock, "/clock", 1000)
    replay = start("replay", bag=bag, rate=20.0, loop=True, clock=True, start_s=19.0, linger_s=0.0)
    heard.until(lambda: heard.count.count(199) >= 3, "the third round")
    assert replay.ask("/status")[1]["rounds"] >= 2
    assert replay.ask("/stop", {})[0] == 200
    first_round = heard.count[: heard.count.index(199) + 1]
    assert first_round == list(range(190, 200))
    assert heard.count[10:210] == list(range(200))
    times_ns = [to_ns(tick.clock) for tick in ticks]
    assert min(times_ns) >= START_NS
    assert max(times_ns) <= START_NS + 20 * SECOND_NS
    backwards = [b for a, b in pairwise(times_ns) if b < a]
    assert backwards
    assert max(backwards) < START_NS + 10 * SECOND_NS


@pytest.fixture(scope="module")
def recomputed(tmp_path_factory) -> dict[str, dict[str, Any]]:
    """What the services compute now from the recordings of replay_references.py."""
    with claimed_domain() as domain:
        return results(REAL if REAL.is_dir() else None, tmp_path_factory.mktemp("references"), domain)


def test_a_simulated_recording_gives_the_stored_results(recomputed):
    """Features, clock models and states of the simulated person are those of the references."""
    expected = {name: table for name, table in stored().items() if name.startswith("p1_")}
    assert len(expected) == 5
    assert [line for name, table in expected.items() for line in changes(table, recomputed[name])] == []


def test_real_recordings_give_the_stored_results(shared_data, recomputed):
    """Features, clock models and states of three real people, replayed at 20x through the graph, are as stored."""
    assert stored().keys() == recomputed.keys()
    assert [line for name, table in stored().items() for line in changes(table, recomputed[name])] == []
