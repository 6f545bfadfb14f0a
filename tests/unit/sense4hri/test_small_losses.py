"""The laws of small losses and of jitter: neither costs an interpreter updates or events."""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest
from brain_signals import brain
from breathing_signals import chest, ecg
from emg_signals import muscle
from eog_signals import eyes
from gaze import looking, pupils
from interpreter_ecg.config import Config as EcgConfig
from interpreter_ecg.stream import EcgStream
from interpreter_eda.config import Config as EdaConfig
from interpreter_eda.stream import EdaStream
from interpreter_eeg.config import Config as EegConfig
from interpreter_eeg.stream import EegStream
from interpreter_emg.config import Config as EmgConfig
from interpreter_emg.stream import EmgStream
from interpreter_eog.config import Config as EogConfig
from interpreter_eog.stream import EogStream
from interpreter_eye_tracking.config import Config as EyeConfig
from interpreter_eye_tracking.stream import EyeStream
from interpreter_motion.config import Config as MotionConfig
from interpreter_motion.stream import MotionStream
from interpreter_ppg.config import Config as PpgConfig
from interpreter_ppg.stream import PpgStream
from interpreter_pupillometry.config import Config as PupilConfig
from interpreter_pupillometry.stream import PupilStream
from interpreter_respiration.config import Config as RespirationConfig
from interpreter_respiration.heart import HeartStream
from interpreter_respiration.stream import RespirationStream
from sense4hri.stamps import SECOND_NS
from slow_signals import event_times_s, play, skin
from walking import acceleration

SECONDS, FRAME_S, LOST = 80, 0.04, 0.03
XYZ = ("x", "y", "z")


class Case(NamedTuple):
    """One interpreter and a signal full of what it tells as events, in the field `events` ("" = it tells none)."""

    make: Callable[[Any], Any]
    samples: np.ndarray
    fs_hz: float
    sensor_type: str
    unit: str
    names: tuple[str, ...]
    events: str


@cache
def cases() -> dict[str, Case]:
    """All interpreters; signals of SECONDS."""
    times_s = np.arange(SECONDS * 50) / 50
    belt = np.sin(2 * np.pi * 0.25 * times_s) + np.random.default_rng(1).normal(0, 0.01, len(times_s))
    pulse = 1000 * np.exp(2 * np.cos(2 * np.pi * 1.2 * np.arange(SECONDS * 100) / 100))
    responses_s = np.arange(8.0, SECONDS - 8, 9.0)
    gaze, _ = looking(200.0, [(0, 0), (8, 3)] * (SECONDS // 2), rest_s=1.0)
    work = [(12.0, 32.0), (40.0, 45.0), (55.0, 60.0)]
    walk = acceleration(SECONDS, 50.0, [(10.0, 70.0, 110.0)])
    blinks_s = np.arange(4.0, SECONDS - 4, 4.0)
    return {
        "ecg": Case(lambda i: EcgStream(EcgConfig(), i), ecg(SECONDS, 250.0), 250.0, "ecg", "uV", ("ecg",), ""),
        "ppg": Case(lambda i: PpgStream(PpgConfig(), i), pulse, 100.0, "ppg", "", ("ppg",), "peak_timestamps"),
        "eda": Case(
            lambda i: EdaStream(EdaConfig(), i),
            skin(SECONDS, 50.0, responses_s, np.full(len(responses_s), 0.5)),
            *(50.0, "eda", "uS", ("eda",), "scr_peak_timestamps"),
        ),
        "eeg": Case(
            lambda i: EegStream(EegConfig(), i), brain(SECONDS, 250.0, 2), 250.0, "eeg", "uV", ("C3", "C4"), ""
        ),
        "emg": Case(
            lambda i: EmgStream(EmgConfig(), i),
            muscle(SECONDS, 1000.0, work),
            *(1000.0, "emg", "uV", ("emg",), "onset_timestamps"),
        ),
        "motion": Case(
            lambda i: MotionStream(MotionConfig(), i), walk, 50.0, "accelerometer", "m/s^2", XYZ, "steps_total"
        ),
        "eog": Case(
            lambda i: EogStream(EogConfig(), i),
            eyes(SECONDS, 250.0, blinks_s),
            *(250.0, "eog", "uV", ("heog", "veog"), "blink_timestamps"),
        ),
        "eye": Case(lambda i: EyeStream(EyeConfig(), i), gaze, 200.0, "eye_tracking", "deg", ("gaze_x", "gaze_y"), ""),
        "pupil": Case(
            lambda i: PupilStream(PupilConfig(), i),
            pupils(100.0, SECONDS, [(30, 40, 0.3)], []),
            *(100.0, "pupillometry", "mm", ("diameter_left", "diameter_right"), ""),
        ),
        "belt": Case(
            lambda i: RespirationStream(RespirationConfig(), i),
            belt,
            *(50.0, "respiration", "", ("respiration",), "breath_timestamps"),
        ),
        "chest": Case(
            lambda i: RespirationStream(RespirationConfig(), i),
            chest(SECONDS, 50.0),
            *(50.0, "accelerometer", "m/s^2", XYZ, "breath_timestamps"),
        ),
        "heart": Case(
            lambda i: HeartStream(RespirationConfig(), i),
            ecg(SECONDS, 250.0),
            *(250.0, "ecg", "uV", ("ecg",), "breath_timestamps"),
        ),
    }


def losses(share: float) -> list[tuple[float, float]]:
    """Frames that are lost, by chance, as times in s; the first second is whole."""
    starts_s = np.arange(1.0, SECONDS, FRAME_S)
    chosen = starts_s[np.random.default_rng(2).random(len(starts_s)) < share]
    return [(start_s - 0.002, start_s - 0.002 + FRAME_S) for start_s in chosen.tolist()]


def played(case: Case, lost: list[tuple[float, float]], late_s: float = 0.0) -> list[Any]:
    """Updates of a case in frames of FRAME_S, stamped late by up to late_s."""
    size = round(FRAME_S * case.fs_hz)
    sizes = [size] * (len(case.samples) // size)
    return play(case.make, case.samples, case.fs_hz, case.sensor_type, case.unit, case.names, sizes, lost, late_s)


@cache
def whole(name: str) -> list[Any]:
    """Updates of a case of which nothing is lost or late."""
    return played(cases()[name], [])


def seconds_told(updates: list[Any]) -> int:
    """In how many seconds something was published: what is told at a hole does not stand in for the rest."""
    return len({update.device_ns // SECOND_NS for update in updates})


def event_count(updates: list[Any], field: str) -> float:
    """How many events were told."""
    if field == "steps_total":
        return next(each.values[0] for each in updates[-1].extra if each.name == field)
    return len(event_times_s(updates, field))


@pytest.mark.parametrize("name", cases())
def test_lost_frames_cost_neither_updates_nor_events(name):
    """With 3 % of the frames lost by chance there are 95 % of the updates, and the events of the whole signal."""
    case = cases()[name]
    holed = played(case, losses(LOST))
    assert seconds_told(holed) >= 0.95 * seconds_told(whole(name)) >= 0.95 * (SECONDS - 2)
    if case.events:
        expected = event_count(whole(name), case.events)
        assert expected >= 3
        assert event_count(holed, case.events) == pytest.approx(expected, rel=0.04)


@pytest.mark.parametrize("name", cases())
def test_losses_closer_than_the_grid_do_not_silence_an_interpreter(name):
    """One short frame lost every 0.8 s leaves an update per second."""
    case = cases()[name]
    lost = [(at_s - 0.002, at_s + FRAME_S - 0.002) for at_s in np.arange(2.0, SECONDS, 0.8).tolist()]
    assert seconds_told(played(case, lost)) >= 0.95 * (SECONDS - 2)


@pytest.mark.parametrize("name", cases())
def test_jitter_is_no_loss(name):
    """Frames stamped late by up to a quarter of their length bring the updates and events of true stamps."""
    case = cases()[name]
    true, jittered = whole(name), played(case, [], FRAME_S / 4)
    assert seconds_told(jittered) >= 0.95 * seconds_told(true)
    if case.events:
        assert event_count(jittered, case.events) == pytest.approx(event_count(true, case.events), rel=0.04)
    for before, after in zip(true[20:], jittered[20:], strict=False):
        assert after.signal_quality == pytest.approx(before.signal_quality, abs=0.1, nan_ok=True)
