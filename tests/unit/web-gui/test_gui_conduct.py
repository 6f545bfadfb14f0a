"""What a stranger does wrong is told in one sentence that names who, what and how it should be."""

import json
from types import SimpleNamespace

import pytest
from sense4hri.beats import Beat
from sense4hri.crowd import MOST
from sense4hri.topics import Topic
from web_gui.conduct import fault, notes
from web_gui.model import MOST_FAULTS, Study
from web_gui.problems import problems

RAW = "sense4hri_msgs/msg/PhysioRaw"
STATE = "sense4hri_msgs/msg/UserState"
CLOCK = "sense4hri_msgs/msg/ClockModel"
TYPES = {"raw": {RAW}, "clock": {CLOCK}, "features": {"sense4hri_msgs/msg/ECG", "sense4hri_msgs/msg/PPG"}}
ROOT = "/humans/physiological"


def topic(name, type_name=RAW, reliability="RELIABLE", durability="VOLATILE"):
    qos = SimpleNamespace(reliability=SimpleNamespace(name=reliability), durability=SimpleNamespace(name=durability))
    return Topic(ROOT + name, type_name, (SimpleNamespace(node_name="stranger", qos_profile=qos),))


@pytest.mark.parametrize(
    ("published", "words"),
    [
        (topic("/p1/ecg/Shimmer_1/raw"), "nobody reads: sensor_id 'Shimmer_1': small letters"),
        (topic("/p__1/ecg/h10_1/raw"), "human_id 'p__1'"),
        (topic("/p1/ecg/h10_1/raw", "std_msgs/msg/String"), f"type std_msgs/msg/String nobody reads: raw is {RAW}"),
        (topic("/p1/ecg/h10_1/features", "a/msg/B"), "features is a features message of sense4hri_msgs"),
        (topic("/p1/ecg/h10_1/raw", reliability="BEST_EFFORT"), "best effort: what gets lost on the way"),
        (topic("/p1/ecg/h10_1/clock", CLOCK), "volatile, which nobody hears"),
        (topic("/p1/ecg/raw"), "streams are /humans/physiological/<human_id>/<sensor_type>/<sensor_id>/<field>"),
        (topic("/p__1/state", STATE), "'p__1' is no human_id"),
        (topic("/p1/state"), f"state is {STATE}"),
    ],
)
def test_what_is_wrong_is_one_sentence(published, words):
    """It begins with the node that publishes, and says what would be right."""
    why = fault(published, TYPES)
    assert why.startswith(f"stranger publishes {published.name}, ")
    assert words in why


def test_what_is_too_much_of_a_process_is_one_sentence_for_all_of_it():
    """A flood of topics is one thing that is wrong, not hundreds."""
    told = {fault(topic(f"/p{number}/ecg/h10_1/raw")._replace(excess=True), TYPES) for number in range(300)}
    assert told == {f"stranger publishes more than {MOST} raw topics, of which only {MOST} are read"}


def test_what_can_be_used_gives_no_sentence():
    """Neither a stream of the contract, nor a state, nor a field of somebody's own."""
    for published in (topic("/p1/ecg/h10_1/raw"), topic("/p1/state", STATE), topic("/p1/ecg/h10_1/own", "a/msg/B")):
        assert fault(published, TYPES) == ""


def test_a_best_effort_publisher_beside_a_reliable_one_is_told():
    """Who hears the topic then hears all of it best effort."""
    reliable, other = topic("/p1/ecg/h10_1/raw"), topic("/p1/ecg/h10_1/raw", reliability="BEST_EFFORT")
    both = reliable._replace(publishers=reliable.publishers + other.publishers)
    assert (reliable.best_effort, both.best_effort) == (False, True)
    assert "best effort" in fault(both, TYPES)


def test_a_state_of_the_study_that_is_published_volatile_is_told_by_name():
    """Only who does it wrong is named; what is latched gives no sentence."""
    right, wrong = (topic("", "a/msg/B", durability=kind).publishers[0] for kind in ("TRANSIENT_LOCAL", "VOLATILE"))
    right.node_name = "session_coordinator"
    assert fault(Topic("/study/session", "a/msg/B", (right,)), TYPES) == ""
    told = fault(Topic("/study/session", "a/msg/B", (right, wrong)), TYPES)
    assert told.startswith("stranger publishes /study/session, volatile, which nobody hears")
    assert fault(topic("/p1/ecg/h10_1/clock", CLOCK, durability="TRANSIENT_LOCAL"), TYPES) == ""


def test_the_registry_says_which_assignment_has_not_happened():
    """Its sentences are taken, but for what the page sees itself and says once; what is no JSON says nothing."""
    told = {
        "!assignment_not_done": "asked for p2, its topics are under p1",
        "!duplicate_sensor_id": ["a", "b"],
        "!quality_of_service": "raw is published best effort",
        "x": "y",
    }
    assert notes(json.dumps(told)) == ["asked for p2, its topics are under p1"]
    assert notes("") == notes("[1]") == notes("{" * 100_000) == []


def test_faults_and_notes_are_problems_for_as_long_as_they_last():
    """At most so many: a stranger with a thousand wrong topics is told often enough."""
    study = Study()
    for number in range(1000):
        study.judge(f"topic {number}", f"wrong {number}")
    study.take_notes({"h10_1": ["asked, not moved"]})
    assert len(list(problems(study, 0))) == MOST_FAULTS + 1
    for number in range(1000):
        study.judge(f"topic {number}", "")
    study.take_notes({})
    assert list(problems(study, 0)) == []


def test_who_hangs_or_was_killed_is_a_problem_until_it_is_back():
    """A silent service within 5 s, its restart for some more; what is told of the recorder is told once."""
    study, second = Study(), 1_000_000_000
    for service in ("clock_sync", "recorder"):
        study.services.take(Beat(service, "1"), 0)
    study.session.recorder.doubt = "the recorder has said nothing for 4 s"
    told = [problem.text for problem in problems(study, 4 * second)]
    assert [text.partition(":")[0] for text in told] == [study.session.recorder.doubt, "clock_sync"]
    study.session.recorder.doubt = ""
    study.services.take(Beat("recorder", "1"), 6 * second)
    study.services.take(Beat("clock_sync", "2"), 6 * second)
    assert ["started afresh" in problem.text for problem in problems(study, 6 * second)] == [True]
    for service in ("clock_sync", "recorder"):
        study.services.take(Beat(service, "2" if service == "clock_sync" else "1"), 20 * second)
    assert list(problems(study, 20 * second)) == []
