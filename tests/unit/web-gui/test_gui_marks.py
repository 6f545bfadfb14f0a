"""What of a features message is drawn, and where it stands."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from sense4hri.chunk import Break, Chunk, TimedChunk
from sense4hri.modalities import MODALITIES
from sense4hri.names import StreamName
from sense4hri_msgs import msg
from sense4hri_msgs.msg import ECG, EEG, EMG, EOG, EyeTracking, PhysioFeature, Pupillometry
from web_gui.drawn import DRAWN
from web_gui.history import Clock, History
from web_gui.intake import plain
from web_gui.marks import MOST_MARKS, Marks
from web_gui.model import Study
from web_gui.problem_log import ProblemLog
from web_gui.snapshot import study_message
from web_gui.stream import Info

S = 1_000_000_000
AHEAD = 1_700_000_000 * S  # the axis is so far ahead of the device's clock


def history(channels=("a", "b"), until_s=700):
    """A stream whose device clock runs from 1 s to until_s."""
    made = History(channels, 1e9, device_time=True)
    for at in range(1, until_s):
        times, samples = np.array([at * S], np.int64), np.zeros((1, len(channels)))
        first = Break.FIRST if at == 1 else None
        made.push(TimedChunk(channels, samples, times, at * S, at * S + AHEAD, first, 0))
    made.set_model(Clock(0, AHEAD, 0.0, 1))
    return made


HISTORY = history()


def shown(marks):
    """All marks as (name, from s, to s, channel, x, y), in s of the device's clock."""
    found = []
    for row in marks.between(HISTORY, 0, 2**62):
        ends_s = ((row[end] - AHEAD) / S for end in ("from_ns", "to_ns"))
        found.append((marks.kinds[row["kind"]].name, *ends_s, row["channel"], row["x"], row["y"]))
    return found


def drawn(sensor_type, *messages):
    """What is drawn of messages, each of which used its samples up to the given second."""
    marks = Marks(DRAWN[sensor_type])
    for at_s, message in messages:
        marks.take(plain(message) | {"device_timestamp": at_s * S})
    return [one[:4] for one in shown(marks)], [one[4:] for one in shown(marks)]


def times(*seconds):
    """Stamps."""
    return [Time(sec=int(s), nanosec=round(s % 1 * S)) for s in seconds]


def extra(**fields):
    """Values that go into `extra`."""
    return [PhysioFeature(name=name, values=values) for name, values in fields.items()]


@pytest.mark.parametrize("sensor_type", sorted(DRAWN))
def test_every_row_is_of_a_modality_and_of_fields_that_its_message_has(sensor_type):
    """Nothing in the table is misspelt: of a message that has every event, every kind makes a mark."""
    message = getattr(msg, MODALITIES[sensor_type].message)()
    for name, form in message.get_fields_and_field_types().items():
        if form == "sequence<builtin_interfaces/Time>":
            setattr(message, name, times(5.0 if name == "onset_timestamps" else 6.0))
        elif name == "channel_quality":
            message.channel_quality = [1.0]
        elif form == "sequence<double>":
            setattr(message, name, [100.0])
        elif form == "sequence<string>":
            setattr(message, name, ["a"])
    message.extra = extra(
        fixation_x=[1.0], fixation_y=[2.0], interpolated_begin_s=[2.0], interpolated_end_s=[1.0], tonic_now=[3.0]
    )
    names = [name for name, *_ in drawn(sensor_type, (10, message))[0]]
    assert sorted(names) == sorted(kind.name for kind in DRAWN[sensor_type])


def test_a_burst_goes_from_its_onset_to_its_offset_on_its_own_channel():
    """Until the offset is told it reaches as far as the muscle is known to be active; then it ends where it ended."""
    names = ["b", "a"]
    begun = EMG(channel_names=names, onset_timestamps=times(7.25), onset_channels=["b"], active=[True, False])
    going = EMG(channel_names=names, active=[True, False])
    ended = EMG(channel_names=names, offset_timestamps=times(9.5), offset_channels=["b"], active=[False, False])
    assert drawn("emg", (8, begun))[0] == [("burst", 7.25, 8.0, 1)]
    assert drawn("emg", (8, begun), (9, going), (10, going))[0] == [("burst", 7.25, 10.0, 1)]
    assert drawn("emg", (8, begun), (9, going), (10, going), (11, ended))[0] == [("burst", 7.25, 9.5, 1)]


def test_a_burst_whose_end_nobody_saw_is_not_drawn_on():
    """An interpreter that starts afresh tells no offset: what it finds later does not lengthen the old burst."""
    begun = EMG(channel_names=["a"], onset_timestamps=times(7.0), onset_channels=["a"], active=[True])
    rest = EMG(channel_names=["a"], active=[False])
    unseen = EMG(channel_names=["a"], active=[True])
    assert drawn("emg", (8, begun), (30, rest), (31, unseen))[0] == [("burst", 7.0, 8.0, 0)]


def test_two_bursts_of_one_message_stay_two():
    """On, off and on again within one second are told in the order of their times."""
    both = EMG(channel_names=["a"], onset_timestamps=times(7.0, 7.6), onset_channels=["a", "a"], active=[True])
    both.offset_timestamps, both.offset_channels = times(7.4), ["a"]
    assert drawn("emg", (8, both))[0] == [("burst", 7.0, 7.4, 0), ("burst", 7.6, 8.0, 0)]


def test_a_fixation_stands_where_and_for_as_long_as_somebody_looked():
    """Onset, duration and place are those of the message."""
    look = EyeTracking(fixation_timestamps=times(5.0, 6.0), fixation_durations_ms=[450.0, 300.0])
    look.extra = extra(fixation_x=[100.0, 300.0], fixation_y=[200.0, 400.0])
    when, where = drawn("eye_tracking", (8, look))
    assert when == [("fixation", 5.0, 5.45, -1), ("fixation", 6.0, 6.3, -1)]
    assert where == [(100.0, 200.0), (300.0, 400.0)]


def test_interpolated_stretches_are_counted_back_from_the_newest_sample():
    """Seconds before the message's device_timestamp."""
    blink = Pupillometry(extra=extra(interpolated_begin_s=[1.5], interpolated_end_s=[1.25]))
    assert drawn("pupillometry", (8, blink))[0] == [("interpolated", 6.5, 6.75, -1)]


def test_a_poor_channel_has_no_share_in_the_bands():
    """A loose electrode carries a thousand times the power of all others: the mean is that of the good ones."""
    caps = EEG(channel_names=["a", "b", "c"], channel_quality=[0.9, 0.1, 0.6], alpha_uv2=[10.0, 1e4, 20.0])
    when, what = drawn("eeg", (8, caps))
    assert what[[name for name, *_ in when].index("α")][0] == 15.0


def test_marks_of_ten_minutes_ago_are_still_there():
    """Scrolled back to its beginning a stream of one beat a second has the beats of that time."""
    marks = Marks(DRAWN["ecg"])
    for second in range(2, 602):
        marks.take(plain(ECG(peak_timestamps=times(second - 0.5))))
    found = marks.between(HISTORY, AHEAD + 5 * S, AHEAD + 15 * S)
    assert ((found["from_ns"] - AHEAD) / S).tolist() == [5.5 + k for k in range(10)]


def test_old_beats_do_not_come_again_with_a_clock_that_begins_anew():
    """They stay where they were drawn; what a device says after its restart is drawn after it."""
    ring, marks = History(("ecg",), 1e9, device_time=True), Marks(DRAWN["ecg"])
    for start_s, begins in (
        (0, Break.FIRST),
        (200, Break.RESET),
    ):  # on the axis; the device's clock is at 1 s both times
        for second in range(1, 61):
            device, received = second * S, AHEAD + (start_s + second) * S
            first = begins if second == 1 else None
            ring.push(TimedChunk(("ecg",), np.zeros((1, 1)), np.array([device]), device, received, first, 0))
            if start_s == 0 or second > 50:
                marks.take(plain(ECG(peak_timestamps=times(second))), ring.samples_total)
    drawn_s = (marks.between(ring, AHEAD, AHEAD + 300 * S)["from_ns"] - AHEAD) / S
    assert drawn_s.tolist() == [*range(1, 61), *range(251, 261)]


def test_beats_of_what_is_played_again_are_those_said_again():
    """A replay that is sought back: no beat stands where nothing has been drawn yet, none twice."""
    ring, marks = History(("ecg",), 1e9, device_time=True), Marks(DRAWN["ecg"])
    for begin_s, late_s in (1, 0), (31, 0.25):
        for second in range(begin_s, 61 if begin_s == 1 else 41):
            device, first = second * S, {1: Break.FIRST, 31: Break.RESET}.get(second if second == begin_s else 0)
            ring.push(TimedChunk(("ecg",), np.zeros((1, 1)), np.array([device]), device, AHEAD + device, first, 0))
            marks.take(plain(ECG(peak_timestamps=times(second + late_s))), ring.samples_total)
    drawn_s = (marks.between(ring, AHEAD, AHEAD + 300 * S)["from_ns"] - AHEAD) / S
    assert drawn_s.tolist() == [second + 0.25 for second in range(31, 41)]


def test_no_more_marks_are_kept_than_can_be_paid_for():
    """Somebody who tells a thousand events in every message costs a bounded memory; the newest stay."""
    marks = Marks(DRAWN["ecg"])
    for second in range(2, 32):
        marks.take(plain(ECG(peak_timestamps=times(*[second + k / 1000 for k in range(1000)]))))
    assert marks.kept_bytes < 1_000_000
    assert len(shown(marks)) == MOST_MARKS
    assert shown(marks)[-1][1] == pytest.approx(31.999)


def test_quality_belongs_to_the_channel_of_its_name():
    """The interpreter's order need not be that of the raw data; what it does not judge is unknown."""
    study = Study()
    stream = study.stream(StreamName("p1", "eeg", "cap"), AHEAD)
    stream.learn(Info(10.0, "uV", {}))
    stream.raw(Chunk(("Fz", "Cz", "Pz"), np.zeros((10, 3)), S, AHEAD), AHEAD)
    stream.take_features(plain(EEG(channel_names=["Pz", "Fz"], channel_quality=[0.25, 1.0])), AHEAD)
    assert study_message(study, ProblemLog(), AHEAD)["streams"][0]["qualities"] == [1.0, None, 0.25]


def test_quality_may_be_an_extra_of_the_channel():
    """What has no arrays by channel tells `heog_quality`, `veog_quality`."""
    study = Study()
    stream = study.stream(StreamName("p1", "eog", "eyes"), AHEAD)
    stream.raw(Chunk(("veog", "heog"), np.zeros((10, 2)), S, AHEAD), AHEAD)
    stream.learn(Info(10.0, "uV", {}))
    stream.take_features(plain(EOG(extra=extra(heog_quality=[0.5], veog_quality=[float("nan")]))), AHEAD)
    assert study_message(study, ProblemLog(), AHEAD)["streams"][0]["qualities"] == [None, 0.5]


def test_what_one_message_said_is_forgotten_together():
    """However often the older half goes, and where more came than is kept: the bands of each second stay complete."""
    marks, bands = Marks(DRAWN["eeg"]), {}
    for at_s in range(1, 42):
        marks.take(plain(EEG()) | {"device_timestamp": at_s * S})
    for _ in range(3):
        marks.halve()
        bands = {}
        for name, from_s, *_ in shown(marks):
            bands.setdefault(from_s, []).append(name)
        assert len({len(names) for names in bands.values()}) == 1
