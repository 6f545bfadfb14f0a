"""Metrics: names of the contract, and never more series than a stranger can make."""

import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from prometheus_client import Counter
from prometheus_client.parser import text_string_to_metric_families
from sense4hri import metrics


def values(made: metrics.Metrics) -> dict[str, dict[str, float]]:
    """By metric and sensor_id."""
    found: dict[str, dict[str, float]] = {}
    for family in text_string_to_metric_families(made.text().decode()):
        for sample in family.samples:
            found.setdefault(sample.name, {})[sample.labels.get("sensor_id", "")] = sample.value
    return found


def test_a_flood_of_sensors_grows_no_metric_without_end():
    """After a thousand label sets the rest are counted under `other`; those that were there go on."""
    made = metrics.Metrics("toy")
    for number in range(3 * metrics.MOST_SERIES):
        made.counter("samples", "Samples.", sensor_id=f"s{number}").inc()
    made.counter("samples", "Samples.", sensor_id="s0").inc()
    series = values(made)["sense4hri_samples_total"]
    assert len(series) == metrics.MOST_SERIES + 1
    assert (series["s0"], series["other"]) == (2, 2 * metrics.MOST_SERIES)


def test_what_has_gone_makes_room_for_what_comes():
    """A node that was there under a thousand names keeps no sensor out; what is there, or is back, keeps its series."""
    made = metrics.Metrics("toy")
    for number in range(metrics.MOST_SERIES):
        labels = {"sensor_id": f"s{number}", "sensor_type": "ecg"}
        made.counter("messages", "Messages.", **labels, field="raw").inc()
        if number >= 2:
            made.gone(**labels)
    made.counter("messages", "Messages.", sensor_id="s2", sensor_type="ecg", field="raw").inc()
    for number in range(5):
        made.counter("messages", "Messages.", sensor_id=f"h10_{number}", sensor_type="ecg", field="raw").inc(7)
    series = values(made)["sense4hri_messages_total"]
    assert len(series) == metrics.MOST_SERIES
    assert {name: series.get(name) for name in ("s0", "s1", "s2", "s3", "s7", "s8", "h10_4", "other")} == {
        "s0": 1,
        "s1": 1,
        "s2": 2,
        "s3": None,
        "s7": None,
        "s8": 1,
        "h10_4": 7,
        "other": None,
    }


def test_only_labels_of_the_contract():
    """A person's id is no label."""
    with pytest.raises(ValueError, match=r"human_id.*are not of the contract"):
        metrics.Metrics("toy").gauge("heart", "Beats.", human_id="p1")


def test_a_counter_kept_elsewhere_is_as_it_is_when_asked():
    """It is a counter for Prometheus too."""
    made, kept = metrics.Metrics("toy"), [1]
    made.counted("handled_calls", "Calls.", lambda: kept[0])
    assert values(made)["sense4hri_handled_calls_total"] == {"": 1}
    kept[0] = 7
    assert values(made)["sense4hri_handled_calls_total"] == {"": 7}
    assert b"# TYPE sense4hri_handled_calls_total counter" in made.text()


def test_nothing_says_when_a_counter_was_made():
    """A second series for each counter tells nobody anything."""
    made = metrics.Metrics("toy")
    made.counter("samples", "Samples.").inc()
    made.histogram("latency_seconds", "Latency.").observe(1.0)
    assert b"_created" not in made.text()


def test_two_threads_may_count_the_same_for_the_first_time(monkeypatch):
    """The ROS thread and the main thread refuse their first message at once: both are counted, neither thread ends."""

    def slowly(*args: Any, **kwargs: Any) -> Counter:
        time.sleep(0.05)
        return Counter(*args, **kwargs)

    monkeypatch.setattr(metrics, "Counter", slowly)
    made = metrics.Metrics("toy")
    with ThreadPoolExecutor(2) as pool:
        for counter in [pool.submit(made.counter, "refused_messages", "Refused.") for _ in range(2)]:
            counter.result().inc()
    assert values(made)["sense4hri_refused_messages_total"] == {"": 2}
