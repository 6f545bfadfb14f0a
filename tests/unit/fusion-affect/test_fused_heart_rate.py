"""Which heart rate counts, and the baseline that it is held against."""

import math

import pytest
from fused import ECG, NAN, PPG, TREE, at, run
from fusion_affect.fusion import Fusion
from fusion_affect.heart_rate import Baseline, Baselines, Reading, combine


def reading(
    pipeline: str, source: str, bpm: float, quality: float = 0.9, age_s: float = 0.5, sensor: str = "s1"
) -> Reading:
    return Reading(pipeline, sensor, source, bpm, quality, age_s)


@pytest.mark.parametrize(
    ("source", "readings", "bpm"),
    [
        ("features", [("ecg", "features", 70.0), ("ecg", "device", 75.0)], 70.0),
        ("device", [("ecg", "features", 70.0), ("ecg", "device", 75.0, NAN)], 75.0),
        ("auto", [("ecg", "features", 70.0), ("ecg", "device", 75.0, NAN)], 70.0),
        ("auto", [("ecg", "features", NAN), ("ecg", "device", 75.0, NAN)], 75.0),
        ("auto", [("ecg", "features", 70.0, 0.1), ("ecg", "device", 75.0, NAN)], 75.0),
        ("features", [("ecg", "device", 75.0)], NAN),
        ("auto", [("ecg", "features", 70.0), ("ppg", "features", 74.0)], 72.0),
        ("auto", [("ecg", "features", 70.0, 0.9, 6.0), ("ppg", "features", 74.0)], 74.0),
        ("auto", [("ecg", "features", 0.0)], NAN),
        ("auto", [("ecg", "features", math.inf)], NAN),
        ("auto", [], NAN),
    ],
)
def test_heart_rate_source(source: str, readings: list[tuple], bpm: float) -> None:
    """The parameter heart_rate_source decides which rate of a sensor counts; pipelines are averaged."""
    found = combine([reading(*r) for r in readings], source, TREE.limits)
    assert found.bpm == pytest.approx(bpm, nan_ok=True)
    assert found.reasons


def test_only_what_concerns_the_heart_rate_is_told() -> None:
    """Of the reasons those about the heart rate are told, and nothing of a source that was not needed."""
    because = ("hrv: needs 30 s", "heart_rate_bpm needs three intervals")
    missing = Reading("ppg", "s1", "features", NAN, NAN, 0.5, because)
    found = combine(
        [missing, reading("ecg", "features", 70.0), reading("ecg", "device", 70.0, age_s=9.0)], "auto", TREE.limits
    )
    assert found.reasons[1:] == ("ppg/s1 features is missing: heart_rate_bpm needs three intervals",)


def test_two_sensors_of_one_pipeline_count_once() -> None:
    """Each pipeline has one vote, however many sensors it has."""
    readings = [
        reading("ecg", "features", 70.0, sensor="a"),
        reading("ecg", "features", 72.0, sensor="b"),
        reading("ppg", "features", 75.0),
    ]
    assert combine(readings, "auto", TREE.limits).bpm == pytest.approx(73.0)


def test_baseline_between_markers() -> None:
    """The median between baseline_start and baseline_end is the resting baseline, and moves the thresholds."""
    fusion = Fusion(TREE)
    run(fusion, 5.0)
    fusion.marker("baseline_start", "", at(5.0))
    run(fusion, 20.0, ecg=60.0, ppg=60.0, start=5.0)
    fusion.marker("baseline_end", "p1", at(24.0))
    last = run(fusion, 8.0, ecg=92.0, ppg=92.0, start=25.0)[-1]
    assert last.state == "stressed_anxious"
    assert "resting baseline 60.0 bpm" in last.reasons
    relative = next(i for i in last.indicators if i.name == "heart_rate_relative")
    assert relative.value == pytest.approx(92 / 60 - 1)
    assert relative.sources == (ECG.topic("features"), PPG.topic("features"))
    assert ("heart_rate_baseline", "1/min", 60.0) in last.extra


def test_a_baseline_may_be_marked_without_stamps() -> None:
    """As `ros2 topic pub` marks it: what came between the two is the baseline."""
    fusion = Fusion(TREE)
    run(fusion, 5.0)
    fusion.marker("baseline_start", "", 0)
    run(fusion, 20.0, ecg=60.0, ppg=60.0, start=5.0)
    fusion.marker("baseline_end", "", 0)
    assert "resting baseline 60.0 bpm" in run(fusion, 8.0, ecg=92.0, ppg=92.0, start=25.0)[-1].reasons


def test_baseline_from_the_first_seconds() -> None:
    """With baseline_s the first so many seconds are the resting baseline; until then the reasons count."""
    fusion = Fusion(TREE, baseline_s=15.0)
    states = run(fusion, 14.0)
    assert "of 15 s" in " | ".join(states[-1].reasons)
    last = run(fusion, 10.0, start=14.0)[-1]
    assert "resting baseline 71.0 bpm" in last.reasons


def test_what_is_needed_is_told_while_a_baseline_is_learnt() -> None:
    """Never less than the ten seconds without which there is none."""
    baseline, told = Baseline(2.5), []
    for second in range(11):
        baseline.learn(at(second), 60.0)
        told.append(baseline.reason)
    learnt = [f"the resting baseline is being learnt: {second} of 10 s" for second in range(1, 10)]
    assert told == [*learnt, *["resting baseline 60.0 bpm"] * 2]


def test_short_baseline_is_not_learnt() -> None:
    """Three seconds of rest are no baseline; the reason says so and the one before stays."""
    baseline = Baseline()
    baseline.mark(at(0), "baseline_start")
    for second in range(12):
        baseline.learn(at(second), 60.0)
    baseline.mark(at(12), "baseline_end")
    baseline.mark(at(13), "baseline_start")
    for second in range(12, 16):
        baseline.learn(at(second), 100.0)
    baseline.mark(at(16), "baseline_end")
    baseline.learn(at(17), 100.0)
    assert baseline.bpm == 60.0
    assert "was not learnt" in baseline.reason


def test_a_baseline_without_heart_rate_is_told() -> None:
    """Rest during which no heart rate could be used leaves no baseline, or the one before, and the reason says so."""
    baseline = Baseline()
    for begin, bpm in ((0, math.nan), (30, 60.0), (60, math.nan)):
        baseline.mark(at(begin), "baseline_start")
        baseline.mark(at(begin + 20), "baseline_end")
        for second in range(begin, begin + 30):
            baseline.learn(at(second), bpm)
        if begin == 0:
            assert baseline.reason == "the resting baseline was not learnt: 0 s of heart rate, 10 are needed"
    assert baseline.bpm == 60.0
    assert baseline.reason.endswith("was not learnt: 0 s of heart rate, 10 are needed; the one of 60.0 bpm stays")


@pytest.mark.parametrize("order", [("start", "end"), ("end", "start")])
@pytest.mark.parametrize("late_s", [0, 20])
def test_markers_count_by_their_stamps_however_late_they_come(order: tuple[str, str], late_s: int) -> None:
    """What was measured between the two stamps is the baseline, and nothing of before or after."""
    baseline, stamps_s = Baseline(), {"start": 10, "end": 40}
    for second in range(80):
        for number, name in enumerate(order):
            if second == 40 + late_s + number * late_s // 4:
                baseline.mark(at(stamps_s[name]), f"baseline_{name}")
        baseline.learn(at(second), 60.0 if 10 <= second < 40 else 90.0)
    assert baseline.bpm == 60.0
    assert baseline.reason == "resting baseline 60.0 bpm"


def test_a_flood_of_markers_is_forgotten() -> None:
    """However many a stranger sets, so many are kept as an hour has seconds, and the newest rest counts."""
    baselines = Baselines(0.0)
    baseline = baselines.of("p1")
    for number in range(2 * Baseline.KEPT):
        baselines.mark(at(0) - number, ("baseline_start", "baseline_end")[number % 2], "p1")
    baselines.mark(at(1), "baseline_start", "p1")
    baselines.mark(at(20), "baseline_end", "p1")
    for second in range(30):
        baseline.learn(at(second), 60.0)
    assert baseline.bpm == 60.0
    kept = [*vars(baseline).values(), *vars(baselines).values()]
    assert max(len(each) for each in kept if hasattr(each, "__len__")) <= Baseline.KEPT


def test_a_late_marker_does_not_turn_time_back() -> None:
    """A marker set afterwards, for a moment long past, leaves the grid and all inputs alone."""
    fusion = Fusion(TREE)
    run(fusion, 60.0)
    fusion.marker("baseline_end", "", at(59.0))
    fusion.marker("baseline_start", "", at(20.0))
    states = run(fusion, 5.0, start=60.0)
    assert [s.state for s in states] == ["calm_relaxed"] * len(states)
    assert states[0].time_ns == at(60)
