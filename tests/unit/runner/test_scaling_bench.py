"""tests/bench: which streams of a large study are in real time, who ended, what larger ones would take."""

import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer

sys.path.append(str(Path(__file__).resolve().parents[2] / "bench"))
import bench_scaling
from scaling_counts import SECOND_NS, behind, packets
from scaling_on_paper import drivers_percent, most_participants, percent_with

T0_NS = 1_700_000_000 * SECOND_NS


@pytest.fixture
def recordings(tmp_path):
    """Two topics with a packet a second, from T0_NS + 0.5 s on; each came to the recorder 3 s later."""
    (tmp_path / "part").mkdir()
    with (tmp_path / "part" / "part_0.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("any", "ros2msg", b"")
        topics = [writer.register_channel(name, "cdr", schema) for name in ("/a/raw", "/a/health")]
        for number in range(40):
            at_ns = T0_NS + SECOND_NS // 2 + number * SECOND_NS
            for topic in topics:
                writer.add_message(topic, at_ns + 3 * SECOND_NS, b"", at_ns)
        writer.finish()
    return tmp_path


def test_packets_are_counted_by_when_their_driver_received_them(recordings):
    """Of raw topics only; the way to the recorder, however long, moves none out of the window or into it."""
    found = packets(recordings, T0_NS + 10 * SECOND_NS, T0_NS + 30 * SECOND_NS)
    assert found == {"/a/raw": 20}


@pytest.mark.parametrize(("count", "told"), [(25, True), (26, True), (27, False), (28, False), (29, True), (0, True)])
def test_a_stream_has_all_its_packets_but_for_one_at_an_end_of_the_window(count, told):
    """Of 27.5 packets 27 or 28 are all; one less or more is told, however small a share of the study it is."""
    good = {f"/{number}/raw": 27 for number in range(100)}
    rates = dict.fromkeys([*good, "/a/raw"], 27.5 / 20.0)
    assert behind(good | {"/a/raw": count}, rates, 20.0) == [f"/a/raw: {count} of 27.5 packets"] * told


def test_a_stream_that_is_not_there_is_told():
    """No packet at all is nothing that anybody may overlook."""
    assert behind({}, {"/a/raw": 1.0}, 20.0) == ["/a/raw: 0 of 20.0 packets"]


def test_a_service_that_has_ended_is_a_row_in_words_and_its_log_is_kept(tmp_path, monkeypatch):
    """The bench goes on: which service, its status, where its log is; nothing else is made of it."""
    monkeypatch.setattr(bench_scaling, "KEPT", tmp_path / "build" / "bench")
    monkeypatch.setattr(bench_scaling, "POINTS", (1,))
    monkeypatch.setattr(bench_scaling, "OTHERS", ())
    monkeypatch.setattr(bench_scaling, "SERVICES", ("recorder",))
    command = [sys.executable, "-c", "import sys; print('the disk is broken'); sys.exit(3)"]

    def start(study, name, *_, **__):
        with study._log(name).open("w") as out:
            study._everybody[name] = subprocess.Popen(command, stdout=out)
        return study._everybody[name]

    monkeypatch.setattr(bench_scaling.Study, "_start", start)
    rows = bench_scaling.rows()
    told = rows[0]
    assert told["what"] == "1 participants, 2 sensors"
    assert told["measured"] == "recorder ended with status 3, log: build/bench/scaling_recorder.log"
    assert told["ok"] is False
    assert rows[1]["measured"] == "0 of 1 tried"
    assert (tmp_path / "build" / "bench" / "scaling_recorder.log").read_text() == "the disk is broken\n"


def test_the_steepest_stretch_of_a_process_goes_on_from_the_last_point():
    """2 % of a core each from 4 to 8 participants, 1 % before and after: 2 % it is; what never rises is never full."""
    tried, percent = [2, 4, 8, 12], [4.0, 6.0, 14.0, 18.0]
    assert percent_with(tried, percent, 20) == 34.0
    assert most_participants(tried, percent) == 53.0
    assert most_participants([2, 4], [3.0, 3.0]) == float("inf")


@pytest.mark.parametrize(("each", "pairs"), [(1.0, 0.02), (1.0, 0.0), (0.0, 0.02)])
def test_drivers_cost_themselves_and_a_share_for_every_other(each, pairs):
    """What is drawn further is the curve that was measured, whichever of both parts is there."""
    tried = [2, 8, 16, 24]
    percent = [each * number + pairs * number**2 for number in tried]
    assert drivers_percent(tried, percent, 96) == pytest.approx(96 * each + 96**2 * pairs)


def test_drivers_that_grow_less_than_their_number_are_drawn_as_a_line():
    """A share for every other that would be below 0 is none: more drivers never cost less."""
    assert drivers_percent([2, 8, 16], [2.0, 7.0, 12.0], 96) == pytest.approx(96 * (4 + 56 + 192) / (4 + 64 + 256))
