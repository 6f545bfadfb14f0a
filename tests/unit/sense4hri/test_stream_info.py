"""What is known of a stream, of what anybody says of it."""

import math

import pytest
from sense4hri.feed import Feed
from sense4hri.names import StreamName
from sense4hri.stream_info import info_of

NAME = StreamName("p1", "eye_tracking", "s1")
GOOD = {
    "eye_tracking.sampling_frequency_hz": 120,
    "eye_tracking.unit": "px",
    "eye_tracking.channel_names": ["gaze_x", "gaze_y"],
    "eye_tracking.range_min": math.nan,
    "eye_tracking.px_per_deg": 30.0,
    "transport_delay_s": 0.02,
    "vendor": "a lab",
}


def of(**changed):
    return info_of(NAME, "node", "/driver_x", GOOD | {key.replace("__", "."): value for key, value in changed.items()})


def test_what_a_driver_says_is_taken_as_it_says_it():
    """A whole number is a rate, NaN is an unknown range, and what is missing is unknown."""
    info = of()
    assert (info.sampling_frequency_hz, info.unit, info.channel_names) == (120.0, "px", ("gaze_x", "gaze_y"))
    assert math.isnan(info.range_min)
    assert math.isnan(info.range_max)
    assert (info.transport_delay_s, info.optional("px_per_deg"), info.problem) == (0.02, 30.0, "")


@pytest.mark.parametrize("rate", [None, math.nan])
def test_who_does_not_know_the_rate_says_nothing(rate):
    """Then others are asked."""
    assert of(eye_tracking__sampling_frequency_hz=rate) is None


WRONG = [
    *(("eye_tracking.sampling_frequency_hz", value) for value in (-1.0, math.inf, 1e307, 1e-320, "fast", True, [1.0])),
    *(("eye_tracking.unit", value) for value in (5, True, ["px"], "x" * 1000)),
    *(("eye_tracking.channel_names", value) for value in (True, "gaze_x", 5, [1, 2], ["x" * 1000], ["x"] * 5000)),
    *(("eye_tracking.range_min", value) for value in ("low", True, math.inf, -1e307, [0.0])),
    *(("transport_delay_s", value) for value in ("late", math.inf, -1e6, False)),
    *(("eye_tracking.px_per_deg", value) for value in ("many", [30.0], math.inf)),
    *(("vendor", value) for value in (7, ["a"], "x" * 100_000)),
]


@pytest.mark.parametrize(("parameter", "value"), WRONG)
def test_what_no_stream_can_have_makes_it_unusable_with_a_sentence(parameter, value):
    """The sentence names node and parameter and is short; nothing else of the stream is believed."""
    info = info_of(NAME, "node", "/driver_x", GOOD | {parameter: value})
    assert info.problem.startswith(f"/driver_x says {parameter} is ")
    assert len(info.problem) < 200
    assert (info.sampling_frequency_hz, info.unit, info.channel_names, info.parameters) == (0.0, "", (), {})


def test_a_stream_of_which_nonsense_is_said_is_refused_by_its_interpreter():
    """The feed makes no step of it and says why, in the same sentence."""
    said = []
    feed = Feed(lambda info: pytest.fail("made a step"), 1.0, refused=said.append)
    info = of(eye_tracking__sampling_frequency_hz=-250.0)
    feed.know(info)
    assert feed._new_step(()) is not None
    assert said == [info.problem]
