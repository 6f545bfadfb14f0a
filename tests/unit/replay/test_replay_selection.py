"""Which topics are played, and as what."""

import pytest
from replay.selection import Selection

STREAM = "/humans/physiological/p1/ecg/h10_1"
EVERYTHING = ("/**",)


@pytest.mark.parametrize("field", ["raw", "device", "health", "clock_measurement"])
def test_raw_keeps_what_devices_said(field):
    """With `raw` everything a driver publishes is played."""
    assert Selection("raw", EVERYTHING, ()).target(f"{STREAM}/{field}") == f"{STREAM}/{field}"


@pytest.mark.parametrize(
    "topic",
    [f"{STREAM}/features", f"{STREAM}/clock", "/humans/physiological/p1/state", "/study/ack", "/clock", "/diagnostics"],
)
def test_raw_leaves_out_what_is_computed(topic):
    """With `raw` what services compute is left out, with `all` it is played."""
    assert Selection("raw", EVERYTHING, ()).target(topic) is None
    assert Selection("all", EVERYTHING, ()).target(topic) == topic


@pytest.mark.parametrize(
    "topic",
    ["/study/session", "/study/markers", "/study/sensors", "/study/assignments", "/tf_static", "/humans/faces/f1/roi"],
)
def test_raw_keeps_the_study_and_foreign_topics(topic):
    """Session, markers, sensors, assignments and whatever else was recorded belong to `raw`."""
    assert Selection("raw", EVERYTHING, ()).target(topic) == topic


def test_globs_choose_and_exclude():
    """A topic is played where a glob of `topics` covers it and none of `exclude` does."""
    selection = Selection("all", ("/humans/physiological/*/ecg/**", "/tf"), ("/**/features",))
    assert selection.target(f"{STREAM}/raw")
    assert selection.target("/tf")
    assert selection.target(f"{STREAM}/features") is None
    assert selection.target("/tf_static") is None
    assert selection.target("/humans/physiological/p1/x/ecg/h10_1/raw") is None


def test_a_remapping_renames_a_topic_or_all_below_it():
    """`/from` is a whole topic or its beginning up to a slash; the first rule that fits is applied."""
    rules = ("/humans/physiological/p1:=/humans/physiological/p9", "/tf:=/old/tf")
    selection = Selection("all", EVERYTHING, (), rules)
    assert selection.target(f"{STREAM}/raw") == "/humans/physiological/p9/ecg/h10_1/raw"
    assert selection.target("/humans/physiological/p10/state") == "/humans/physiological/p10/state"
    assert selection.target("/tf") == "/old/tf"
    assert selection.target("/tf_static") == "/tf_static"


def test_topics_of_every_node_are_played_only_under_another_name():
    """`/rosout` and `/parameter_events` have publishers always; renamed they can be played."""
    assert Selection("all", EVERYTHING, ()).target("/rosout") is None
    assert Selection("all", EVERYTHING, (), ("/rosout:=/recorded/rosout",)).target("/rosout") == "/recorded/rosout"


@pytest.mark.parametrize("rule", ["/a", "a:=/b", "/a:=b", "/a:=/b c", "/a/:=/b", "/a:=", "/1:=/b"])
def test_a_rule_that_is_none_is_named(rule):
    """A malformed remapping is refused with its text."""
    with pytest.raises(ValueError, match="remap"):
        Selection("all", EVERYTHING, (), (rule,))
