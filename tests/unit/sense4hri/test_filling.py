"""Messages filled by field name: what fits is written, what does not fit is an error at start, the rest is unknown."""

import math
from typing import Any, NamedTuple

import pytest
from sense4hri import filling

msgs = pytest.importorskip("sense4hri_msgs.msg")


class Variability(NamedTuple):
    rmssd_ms: float


class Word(NamedTuple):
    name: str
    unit: str
    values: tuple[float, ...]


class Update(NamedTuple):
    device_ns: int | None
    received_ns: int
    peak_timestamps: tuple[int, ...] = (1_500_000_000, 2_000_000_001)
    rr_intervals_ms: tuple[float, ...] = (math.nan, 500.0)
    hrv: Variability = Variability(20.0)
    extra: tuple[Word, ...] = (Word("r_amplitude", "uV", (900.0,)),)
    reasons: tuple[str, ...] = ("a", "b")


def test_every_field_goes_where_its_name_says():
    """Times, arrays, nested messages and arrays of them are written; stamps and header are left to the kit."""
    filling.check(Update, msgs.ECG)
    message = filling.fill(filling.blank(msgs.ECG), Update(7, 8))
    assert [(time.sec, time.nanosec) for time in message.peak_timestamps] == [(1, 500_000_000), (2, 1)]
    assert math.isnan(message.rr_intervals_ms[0])
    assert message.rr_intervals_ms[1] == 500.0
    assert message.hrv.rmssd_ms == 20.0
    assert [(word.name, word.unit, list(word.values)) for word in message.extra] == [("r_amplitude", "uV", [900.0])]
    assert message.reasons == ["a", "b"]
    assert message.device_timestamp.sec == message.header.stamp.nanosec == 0


@pytest.mark.parametrize("name", ["ECG", "PPG", "EDA", "EMG", "EEG", "EOG", "EyeTracking", "Pupillometry", "Motion"])
def test_what_nobody_filled_is_unknown_not_zero(name):
    """Of every features message each number is NaN and each count -1; arrays are empty; nested ones too."""

    def numbers(message: Any) -> list[Any]:
        found = []
        for field, kind in message.get_fields_and_field_types().items():
            value = getattr(message, field)
            if kind in ("double", "int32"):
                found.append(value)
            elif kind == "sense4hri_msgs/HRV":
                found += numbers(value)
        return found

    values = numbers(filling.blank(getattr(msgs, name)))
    assert values
    assert all(math.isnan(value) if isinstance(value, float) else value == -1 for value in values)


def of(**fields: Any) -> type:
    return NamedTuple("Odd", [("device_ns", int), ("received_ns", int), *fields.items()])


@pytest.mark.parametrize(
    ("update", "says"),
    [
        (of(heart_rate=float), "Odd.heart_rate: ECG has no field of this name"),
        (of(header=int), "Odd.header: the kit fills this field of ECG"),
        (of(hrv=NamedTuple("Inner", [("rmssd", float)])), "rmssd: HRV has no field of this name"),
        (of(hrv=float), "Odd.hrv: ECG has sense4hri_msgs/HRV here"),
        (of(rr_intervals_ms=float), "Odd.rr_intervals_ms: ECG has sequence<double> here"),
        (of(heart_rate_bpm=tuple[float, ...]), "Odd.heart_rate_bpm: ECG has double here"),
        (NamedTuple("Bare", [("received_ns", int)]), "Bare has no field device_ns"),
    ],
)
def test_what_does_not_fit_is_an_error_that_names_it(update, says):
    """A field that the message lacks, or has in another shape, is told before the first sample."""
    with pytest.raises(TypeError, match=says):
        filling.check(update, msgs.ECG)
