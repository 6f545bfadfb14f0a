"""The two laws, stamps as they come, blinks, areas of interest."""

import numpy as np
import pytest
from gaze import at_stamps, extra_of, in_deg, looking
from interpreter_eye_tracking.config import Config
from interpreter_eye_tracking.stream import EyeStream
from slow_signals import T0_NS, event_times_s, play

PLACES = np.random.default_rng(5).uniform([-15, -10], [15, 10], (30, 2))
NAMES = ("gaze_x", "gaze_y")
FIELDS = ("fixation_timestamps", "saccade_timestamps", "blink_timestamps")
FS_HZ = 125.0  # its samples are whole ns apart, so that times do not depend on the cut


def make(info):
    return EyeStream(Config(), info)


def blinking():
    """Gaze that is lost for 150 ms three times, and the onsets of its saccades."""
    gaze, onsets_s = looking(FS_HZ, PLACES)
    for at in (240, 600, 900):
        gaze[at : at + 19] = np.nan
    return gaze, onsets_s


def test_the_result_does_not_depend_on_how_samples_are_cut():
    """One signal with blinks, spikes and frozen stretches in frames of 1, 7 and random sizes: the same updates."""
    gaze, _ = blinking()
    gaze[400] += 9.0
    gaze[260:580, 1] = gaze[260, 1]
    gaze[1000:1300] = gaze[1000]
    n = len(gaze)
    sizes = ([1] * n, [7] * n, np.random.default_rng(2).integers(1, 60, n).tolist())
    texts = [repr([update._replace(received_ns=0) for update in in_deg(gaze, FS_HZ, make, sizes=cut)]) for cut in sizes]
    assert texts[0] == texts[1] == texts[2]
    assert len(texts[0]) > 1000


def test_events_are_told_once_in_order_and_within_2_s_of_their_end():
    """Saccades, fixations and blinks: times rise from message to message, arrays have one length, none is late."""
    gaze, onsets_s = blinking()
    updates = in_deg(gaze, FS_HZ, make)
    for field in FIELDS:
        times_s, durations = event_times_s(updates, field), field.replace("timestamps", "durations_ms")
        assert (np.diff(times_s) > 0).all()
        for update in updates:
            told = zip(getattr(update, field), getattr(update, durations), strict=True)
            assert all(0 <= update.device_ns - time_ns - ms * 1e6 <= 2e9 for time_ns, ms in told)
    np.testing.assert_allclose(event_times_s(updates, "blink_timestamps"), np.array([240, 600, 900]) / FS_HZ, atol=1e-6)
    assert updates[-1].blink_count == 3
    assert updates[-1].saccade_count > 0.8 * len(onsets_s)


def test_who_never_rests_is_told_as_soon():
    """Saccades so close that none is ever followed by a rest that settles it: each is told within 2 s all the same."""
    gaze, onsets_s = looking(FS_HZ, np.tile(PLACES, (4, 1)), rest_s=0.09)
    updates = in_deg(gaze, FS_HZ, make)
    assert sum(len(update.saccade_timestamps) for update in updates) > 0.5 * len(onsets_s)
    for update in updates:
        told = zip(update.saccade_timestamps, update.saccade_durations_ms, strict=True)
        assert all(update.device_ns - time_ns - ms * 1e6 <= 2.1e9 for time_ns, ms in told)


def test_a_look_away_is_no_blink_and_a_lost_sample_neither():
    """Gaze that is lost for 2 s, and for single samples, lowers the share of valid samples and adds no blink."""
    gaze, _ = looking(FS_HZ, PLACES)
    gaze[300:540], gaze[700:900:20] = np.nan, np.nan
    last = in_deg(gaze, FS_HZ, make)[-1]
    assert last.blink_count == 0
    assert last.valid_ratio == pytest.approx(1 - 250 / len(gaze), abs=0.02)


def test_a_hole_hides_what_is_in_it_and_nothing_else():
    """Of 3 s that never came the saccades are missing, the others are as without the hole, and nothing spans it."""
    gaze, _ = looking(FS_HZ, PLACES)
    whole = event_times_s(in_deg(gaze, FS_HZ, make), "saccade_timestamps")
    updates = in_deg(gaze, FS_HZ, make, lost=[(3.0, 6.0)])
    found = event_times_s(updates, "saccade_timestamps")
    outside = [at_s for at_s in whole if at_s < 2.7 or 6.1 < at_s < 9.5]
    assert all(np.abs(found - at_s).min() < 0.01 for at_s in outside)
    assert not ((found > 3.0) & (found < 5.7)).any()
    assert max(ms for update in updates for ms in update.fixation_durations_ms) < 700
    assert updates[-1].blink_count == 0


def test_samples_without_a_fixed_rate_have_their_own_times():
    """Stamps that jitter by a third of the period: the same saccades; late samples are counted and left out."""
    gaze, onsets_s = looking(FS_HZ, PLACES)
    stamps_s = np.arange(len(gaze)) / FS_HZ + np.random.default_rng(1).uniform(-0.0028, 0.0028, len(gaze))
    gaze = np.column_stack([np.interp(stamps_s, np.arange(len(gaze)) / FS_HZ, gaze[:, k]) for k in (0, 1)])
    found = event_times_s(at_stamps(gaze, stamps_s, make), "saccade_timestamps")
    assert sum(np.abs(found - at_s).min() < 0.02 for at_s in onsets_s) > 0.95 * len(onsets_s)
    swapped = stamps_s.copy()
    swapped[500:520:2] = stamps_s[496:516:2]
    last = at_stamps(gaze, swapped, make)[-1]
    assert extra_of(last, "backward_stamps") == (10.0,)
    assert extra_of(last, "irregular_intervals")[0] >= 5
    assert last.window_s > 9
    assert last.saccade_count > 0.9 * len(onsets_s)


@pytest.mark.parametrize("first_hz", [10.0, 400.0])
def test_a_tracker_without_a_fixed_rate_is_not_judged_by_its_first_second(first_hz):
    """A second of few samples, or of a burst, then 60 per s: a good quality and no sample missing in the end."""
    gaze, _ = looking(FS_HZ, np.tile(PLACES, (4, 1)))
    stamps_s = np.concatenate([np.arange(first_hz) / first_hz, 1 + np.arange(29 * 60) / 60])
    gaze = np.column_stack([np.interp(stamps_s, np.arange(len(gaze)) / FS_HZ, gaze[:, k]) for k in (0, 1)])
    last = at_stamps(gaze, stamps_s, lambda info: EyeStream(Config(window_s=10.0), info))[-1]
    assert last.signal_quality > 0.9
    assert extra_of(last, "missing_samples") == (0.0,)


def test_a_device_that_starts_afresh_begins_a_new_window():
    """Stamps that go back by a minute are a new clock, no late samples."""
    gaze, _ = looking(FS_HZ, PLACES)
    stamps_s = 100 + np.arange(len(gaze)) / FS_HZ
    stamps_s[700:] -= 60
    last = at_stamps(gaze, stamps_s, make)[-1]
    assert last.window_s < (len(gaze) - 700) / FS_HZ
    assert extra_of(last, "backward_stamps") == (0.0,)


def test_areas_of_interest_have_their_dwell_times(tmp_path):
    """A rectangle and a triangle from a file: seconds in which gaze was inside, over the window."""
    path = tmp_path / "areas.yaml"
    path.write_text(
        "- {name: left, rectangle: [-20, -10, 0, 10]}\n- {name: tip, polygon: [[5, -1], [5, 1], [15, 0]]}\n"
    )
    gaze, _ = looking(FS_HZ, [(-8.0, 3.0), (7.0, 0.1), (7.0, 5.0)] * 10, rest_s=0.5)
    config = Config(areas_file=str(path))
    last = in_deg(gaze, FS_HZ, lambda info: EyeStream(config, info))[-1]
    assert extra_of(last, "dwell_left")[0] == pytest.approx(5.5, abs=0.3)
    assert extra_of(last, "dwell_tip")[0] == pytest.approx(5.1, abs=0.3)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "list of 1 to 64"),
        ("- {name: a}", "rectangle"),
        ("- {name: A b, rectangle: [0, 0, 1, 1]}", "small letters"),
        ("- {name: a, rectangle: [0, 0, 1]}", "area a"),
        ("- {name: a, polygon: [[0, 0], [1, x]]}", "area a"),
        ("- {name: a, rectangle: [3, 0, 3, 5]}", "area a: .*one line"),
        ("- {name: a, polygon: [[0, 0], [1, 1], [2, 2]]}", "area a: .*one line"),
        ("- {name: a, rectangle: [0, 0, 1, 1]}\n- {name: a, rectangle: [0, 0, 1, 1]}", "alike"),
        ("[", "no YAML"),
    ],
)
def test_a_wrong_file_of_areas_is_named(tmp_path, text, word):
    """Whatever is wrong in it: one sentence that begins with the parameter; so is a file that is absent."""
    path = tmp_path / "areas.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"^areas_file: .*{word}"):
        Config(areas_file=str(path))
    with pytest.raises(ValueError, match=r"^areas_file: cannot read"):
        Config(areas_file=str(tmp_path / "absent.yaml"))


def test_times_are_of_the_events_clock():
    """The first fixation begins with the first sample."""
    gaze, _ = looking(FS_HZ, PLACES[:8])
    first = next(update for update in in_deg(gaze, FS_HZ, make) if update.fixation_timestamps)
    assert first.fixation_timestamps[0] == T0_NS


@pytest.mark.parametrize("fs_hz", [FS_HZ, 0.0])
def test_what_is_lost_in_long_holes_counts_as_missing(fs_hz):
    """Half of a minute that never came, in holes of 2 s: so many samples are missing, and the quality is half."""
    gaze, _ = looking(FS_HZ, np.tile(PLACES, (6, 1)))
    gaze = gaze[: round(60 * FS_HZ)]
    lost = [(begin_s, begin_s + 2.0) for begin_s in np.arange(2.0, 60.0, 4.0)]
    last = play(make, gaze, fs_hz, "eye_tracking", "deg", NAMES, [1] * len(gaze), lost, true_hz=FS_HZ)[-1]
    missing = extra_of(last, "missing_samples")[0]
    assert missing == pytest.approx(14 * 2.0 * FS_HZ, rel=0.02)
    assert last.signal_quality == pytest.approx(1 - missing / (FS_HZ * last.window_s), abs=0.03)


def test_a_saccade_is_told_also_where_a_hole_follows_an_update_at_once():
    """The last saccade ends 45 ms before 3 s that never came, whose last sample before is that of an update."""
    gaze = np.random.default_rng(3).normal(0, 0.02, (round(10 * FS_HZ), 2))
    gaze[round(4.92 * FS_HZ) :, 0] += 8.0
    updates = in_deg(gaze, FS_HZ, make, sizes=[1] * len(gaze), lost=[(5.0 + 0.5 / FS_HZ, 8.0)])
    np.testing.assert_allclose(event_times_s(updates, "saccade_timestamps"), [4.91], atol=0.02)


def test_a_rate_is_that_of_the_time_without_a_hole():
    """A saccade every 0.5 s and a blink every 3 s, and 9.5 s that never came: every sure rate is as without them."""
    gaze, _ = looking(FS_HZ, np.tile([[-5, 0], [5, 0]], (60, 1)), rest_s=0.457)
    for at_s in np.arange(2.2, 60.0, 3.0):
        gaze[round(at_s * FS_HZ) : round((at_s + 0.15) * FS_HZ)] = np.nan
    updates = in_deg(gaze, FS_HZ, make, sizes=[1] * len(gaze), lost=[(25.0, 34.5)])[20:]
    sure = [update for update in updates if update.signal_quality >= 0.7]
    whole = in_deg(gaze, FS_HZ, make, sizes=[1] * len(gaze))[-1]
    assert len(sure) > 25
    np.testing.assert_allclose([update.blink_rate_per_min for update in sure], whole.blink_rate_per_min, rtol=0.12)
    rates = [extra_of(update, "saccade_rate_per_min")[0] for update in sure]
    np.testing.assert_allclose(rates, extra_of(whole, "saccade_rate_per_min")[0], rtol=0.12)


@pytest.mark.parametrize("hole_s", [0.1, 0.35])
def test_a_rest_that_a_hole_cuts_is_no_fixation(hole_s):
    """A stare of a minute, of which a moment never came every two seconds: no piece of it is a fixation."""
    stare = np.random.default_rng(8).normal(0, 0.02, (round(60 * FS_HZ), 2))
    lost = [(begin_s, begin_s + hole_s) for begin_s in np.arange(0.0, 60.0, 2.0)]
    updates = in_deg(stare, FS_HZ, make, sizes=[1] * len(stare), lost=lost)
    assert [each for update in updates for each in update.fixation_timestamps] == []
    assert "no fixation has ended in the window: fixation_duration_ms" in updates[-1].reasons
