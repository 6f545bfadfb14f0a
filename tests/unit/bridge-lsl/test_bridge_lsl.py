"""bridge-lsl: what outlets say of themselves, what of a features message goes out, and when samples were taken."""

import math
from xml.etree import ElementTree

import numpy as np
import pylsl
import pytest
from bridge_lsl.described import numbers, of_features, of_markers, of_raw, row
from bridge_lsl.outlets import Offered, stream_info
from bridge_lsl.stamping import Model, Stamping, here_ns
from sense4hri import lsl
from sense4hri.chunk import Chunk
from sense4hri.host_clocks import HostClocks
from sense4hri.lsl_types import channel_type
from sense4hri.names import StreamName
from sense4hri.signal_files.units import spelt
from sense4hri.stream_info import StreamInfo
from sense4hri_msgs.msg import ECG, HostClock, HostClockArray, Motion

NAME = StreamName("p1", "ecg", "h10_1")
RECEIVED_NS, DEVICE_NS = 1_700_000_000_000_000_000, 600_000_000_000_000_000
SECOND_NS = 1_000_000_000


def frame(last_ns, received_ns, samples=13):
    return Chunk(("ecg",), np.zeros((samples, 1)), last_ns, received_ns)


def test_a_raw_stream_is_described_as_lsl_tools_expect_it():
    """Type, unit, labels and who made it; another wearer is another source."""
    info = StreamInfo(NAME, 130.0, "uV", ("ecg",), parameters={"vendor": "Polar", "model": "H10", "serial_number": ""})
    outlet = of_raw(info, ("ecg",))
    assert (outlet.name, outlet.content_type, outlet.rate_hz) == ("p1 ecg h10_1", "ECG", 130.0)
    assert outlet.channels == (("ecg", "microvolts", "ECG"),)
    assert outlet.about["manufacturer"] == "Polar"
    assert "serial_number" not in outlet.about
    other = of_raw(StreamInfo(NAME._replace(human_id="p2"), 130.0, "uV"), ("ecg",))
    assert other.source_id != outlet.source_id


def test_no_outlet_is_taken_for_the_same_one_of_another_study(monkeypatch):
    """An inlet whose outlet goes takes up whichever has its source_id: it went on with the p1 of another ROS domain."""
    found = []
    for domain in ("7", "7", "8"):
        monkeypatch.setenv("ROS_DOMAIN_ID", domain)
        outlets = of_raw(StreamInfo(NAME, 130.0, "uV"), ("ecg",)), of_features(NAME, ("a",)), of_markers()
        found.append({outlet.source_id for outlet in outlets})
        assert all(source_id.startswith(lsl.OURS) for source_id in found[-1])
    assert found[0] == found[1]
    assert len(found[1] | found[2]) == 6


@pytest.mark.parametrize(("unit", "written"), [("uV", "microvolts"), ("1", "normalized"), ("px", "px"), ("uS", "uS")])
def test_no_unit_is_a_number_and_each_is_read_back_as_it_was(unit, written):
    """MNE-LSL takes `1` for a factor of ten: shares of a picture became tens of them."""
    (channel,) = of_raw(StreamInfo(NAME, 130.0, unit), ("a",)).channels
    assert (channel[1], spelt(channel[1])) == (written, unit)


def test_the_confidence_of_an_eye_is_no_length():
    """It is a share from 0 to 1 beside diameters in mm or gaze in pixels."""
    channels = ("diameter_left", "confidence")
    outlet = of_raw(StreamInfo(NAME._replace(sensor_type="pupillometry"), 200.0, "mm"), channels)
    assert [unit for _, unit, _ in outlet.channels] == ["mm", "normalized"]
    kind, label, unit = outlet.content_type, *outlet.channels[1][:2]
    assert channel_type(lsl.sensor_type(kind), kind, label, unit) == "pupillometry", "to driver-lsl, too, it is of it"


def test_every_number_of_a_features_message_is_a_channel():
    """Numbers within are named with their place; lists and times have no fixed length and stay out."""
    message = ECG(heart_rate_bpm=64.5, peak_count=11)
    message.hrv.sdnn_ms = 41.0
    values = numbers(message)
    assert (values["heart_rate_bpm"], values["peak_count"], values["hrv.sdnn_ms"]) == (64.5, 11.0, 41.0)
    assert not {"peak_timestamps", "rr_intervals_ms", "reasons", "header"} & set(values)
    assert "posture" not in numbers(Motion(posture="upright"))
    assert of_features(NAME, tuple(values)).rate_hz == 0.0
    assert math.isnan(row({}, ("a",))[0])
    assert of_markers().form == "string"


def test_samples_are_where_the_clock_model_puts_them():
    """Not at their receipt, which is 70 ms late: each at its own device time."""
    stamping = Stamping(130.0)
    stamping.model = Model(DEVICE_NS, RECEIVED_NS - DEVICE_NS - 70_000_000, 0.0)
    for second in range(1, 5):
        last_ns = DEVICE_NS + second * SECOND_NS // 10
        times_ns = stamping.wall_ns(frame(last_ns, RECEIVED_NS + second * SECOND_NS // 10))
        assert times_ns[-1] == RECEIVED_NS + second * SECOND_NS // 10 - 70_000_000
        assert np.diff(times_ns) == pytest.approx(SECOND_NS / 130, rel=0.01)


@pytest.mark.parametrize("model", [None, Model(0, 0, 0.0), Model(DEVICE_NS, RECEIVED_NS, 0.0)])
def test_without_a_model_that_fits_the_newest_sample_is_at_its_receipt(model):
    """A model of another epoch of the device would put it years away."""
    stamping = Stamping(130.0)
    stamping.model = model
    times_ns = stamping.wall_ns(frame(DEVICE_NS, RECEIVED_NS))
    assert times_ns[-1] == RECEIVED_NS
    assert stamping.event_ns(RECEIVED_NS, DEVICE_NS) == RECEIVED_NS


def test_a_model_of_the_clock_before_a_reset_is_not_used():
    """A strap that began anew after 30 s seemed to send what it had sampled 30 s ago, until the next model came."""
    stamping = Stamping(130.0)
    stamping.model = Model(DEVICE_NS, RECEIVED_NS - DEVICE_NS - 70_000_000, 0.0)
    stamping.wall_ns(frame(DEVICE_NS, RECEIVED_NS))
    for tenths in (1, 2):
        received_ns = RECEIVED_NS + tenths * SECOND_NS // 10
        times_ns = stamping.wall_ns(frame(received_ns - RECEIVED_NS + DEVICE_NS - 30 * SECOND_NS, received_ns))
        assert times_ns[-1] == received_ns
    stamping.model = Model(DEVICE_NS, RECEIVED_NS - DEVICE_NS + 30 * SECOND_NS - 70_000_000, 0.0)
    received_ns += SECOND_NS // 10
    times_ns = stamping.wall_ns(frame(received_ns - RECEIVED_NS + DEVICE_NS - 30 * SECOND_NS, received_ns))
    assert times_ns[-1] == received_ns - 70_000_000


def test_features_too_are_not_stamped_by_the_model_of_the_clock_before_a_reset():
    """Those of a device that began anew after 30 s were offered as 30 s old."""
    stamping = Stamping(0.0)
    stamping.model = Model(DEVICE_NS, RECEIVED_NS - DEVICE_NS - 70_000_000, 0.0)
    assert stamping.event_ns(RECEIVED_NS, DEVICE_NS) == RECEIVED_NS - 70_000_000
    for second in (1, 2):
        received_ns = RECEIVED_NS + second * SECOND_NS
        assert stamping.event_ns(received_ns, DEVICE_NS + (second - 30) * SECOND_NS) == received_ns


def test_the_model_of_the_clock_since_a_reset_may_come_before_what_it_is_for():
    """Features of the new clock come a second after its model, which goes for the first of them."""
    for told_ns in (
        lambda stamping, received_ns, device_ns: stamping.event_ns(received_ns, device_ns),
        lambda stamping, received_ns, device_ns: stamping.wall_ns(frame(device_ns, received_ns))[-1],
    ):
        stamping = Stamping(130.0)
        for segment, begun_s in ((1, 0), (2, 30)):
            at_ns, device_ns = RECEIVED_NS + begun_s * SECOND_NS, DEVICE_NS - begun_s * SECOND_NS
            stamping.model = Model(device_ns, at_ns - device_ns - 70_000_000, 0.0, segment)
            assert told_ns(stamping, at_ns + SECOND_NS, device_ns + SECOND_NS) == at_ns + SECOND_NS - 70_000_000


def test_two_events_in_one_tick_of_a_clock_are_no_reset():
    """The model goes on: both are where it puts them."""
    stamping = Stamping(0.0)
    stamping.model = Model(DEVICE_NS, RECEIVED_NS - DEVICE_NS - 70_000_000, 0.0)
    for received_ns in (RECEIVED_NS, RECEIVED_NS + 1):
        times_ns = stamping.wall_ns(Chunk(("x",), np.zeros((1, 1)), DEVICE_NS, received_ns))
        assert times_ns.tolist() == [RECEIVED_NS - 70_000_000]


def test_a_device_without_a_clock_keeps_the_receipts():
    """Its samples are already on the wall clock."""
    times_ns = Stamping(0.0).wall_ns(Chunk(("x",), np.zeros((1, 1)), None, RECEIVED_NS))
    assert times_ns.tolist() == [RECEIVED_NS]


@pytest.mark.parametrize("here", ["lab-a", "lab-b", "lab-c"])
@pytest.mark.parametrize("host", ["lab-a", "lab-b", "lab-c", ""])
def test_times_of_another_host_are_put_on_this_one_s_clock(host, here):
    """One moment by three clocks, the second an hour behind and drifting: whoever stamps it, it is the same moment."""
    behind_ns, ahead_ns, skew = 3600 * SECOND_NS, -70_000_000, 1e-4
    clocks, measured_ns = HostClocks(), RECEIVED_NS - behind_ns - 100 * SECOND_NS
    message = HostClockArray(
        clocks=[
            HostClock(host="lab-b", reference="lab-a", offset_ns=behind_ns, skew_ppm=100.0),
            HostClock(host="lab-c", reference="lab-a", offset_ns=ahead_ns),
        ]
    )
    for entry in message.clocks:
        entry.measured_at.sec = measured_ns // SECOND_NS
    clocks.take(message, 0.0)
    shown_b_ns = measured_ns + round((RECEIVED_NS - behind_ns - measured_ns) / (1 + skew))
    shown_ns = {"lab-a": RECEIVED_NS, "lab-b": shown_b_ns, "lab-c": RECEIVED_NS - ahead_ns}
    told_ns = np.array([shown_ns[host or here]])
    assert abs(int(here_ns(told_ns, host, here, clocks)[0]) - shown_ns[here]) < 1000


@pytest.mark.parametrize("stray", ["\x01", "\x15", "\x1b", "\n", "\x7f", "\ufffe"])
def test_no_text_of_a_stranger_makes_a_description_that_no_reader_takes(stray):
    """One control character in a label, a unit or a vendor's name, and the whole outlet was no XML any more."""
    info = StreamInfo(NAME, 130.0, f"u{stray}V", ("ecg",), parameters={"vendor": f"Po{stray}lar"})
    described = ElementTree.fromstring(stream_info(of_raw(info, (f"e{stray}cg", "b"))).as_xml())
    labels = [label.text or "" for label in described.iter("label")]
    assert [(label[0], label[2:]) for label in labels] == [("e", "cg"), ("b", "")]
    assert [stray in text for text in (labels[0], described.findtext("desc/manufacturer"))] == [False, False]


class Pushed:
    """What liblsl was given, in how many calls."""

    def __init__(self, info, max_buffered):
        self.calls = []

    def push_chunk(self, rows, stamps_s):
        self.calls.append((rows, stamps_s))


@pytest.mark.parametrize("rows", [np.ones((3000, 8)), [["stimulus", "face 3", "p1"]]])
def test_a_message_is_one_call_of_liblsl_whatever_its_rate(monkeypatch, rows):
    """Sample by sample eight channels of 30 kHz took half a core; every row keeps its own stamp."""
    monkeypatch.setattr(pylsl, "StreamOutlet", Pushed)
    offered = Offered(of_markers())
    offered.push(rows, RECEIVED_NS + np.arange(len(rows)) * 33_333)
    ((given, stamps_s),) = offered._outlet.calls
    assert given is rows
    assert np.diff(stamps_s) == pytest.approx(33_333e-9, abs=1e-6)
    assert len(stamps_s) == len(rows)
