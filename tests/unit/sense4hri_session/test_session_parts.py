"""A session in several folders, as a recorder leaves it that was killed and started again."""

import json
import re
import shutil

import pandas as pd
import pytest
import sense4hri_session
from sense4hri_recording import recorder_json
from sense4hri_recording.errors import SessionError
from sense4hri_recording.parts import find, parts
from sense4hri_report import make_report
from sense4hri_report.__main__ import main as report
from sense4hri_session.__main__ import main
from sense4hri_session.withdraw import main as withdraw

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
FROM_S, TO_S = 2.0, 3.5  # nobody recorded


def tell(folder, session_id="s1", start_ns=START_NS, **more):
    """Write recorder.json as of a part of a session."""
    session = {"session_id": session_id, "study": "Trust", "start_at_ns": start_ns, **more}
    recorder_json.write(folder, recorder_json.RecorderJson("complete", session=session, opened_ns=1))


@pytest.fixture
def two(study, short_study):
    """(first, second, whole): a session in two folders, 1.5 s apart, and what would have been recorded."""
    short_study(study)
    everything = sorted(study.messages)
    first = study.write([m for m in everything if m[0] < START_NS + FROM_S * SECOND])
    second = study.write([m for m in everything if m[0] >= START_NS + TO_S * SECOND])
    tell(first)
    tell(second)
    assert second.name == f"{first.name}_1"
    whole = study.write(everything)
    return first, second, whole.rename(whole.parent / "whole")


def samples(path, **options):
    return sense4hri_session.open(path, **options)["p1/ecg/h10_1"].frame()


def test_every_way_to_name_a_session_opens_all_of_it(two):
    """The first folder, the second one and the session's id give the same samples, those of both in order."""
    first, second, _ = two
    own = [samples(path, only_this_part=True) for path in (first, second)]
    assert all(len(frame) for frame in own)
    for path in (first, second, first.parent / "s1"):
        frame = samples(path)
        assert frame["ecg"].tolist() == pd.concat(own)["ecg"].tolist()
        assert frame.index.is_monotonic_increasing


@pytest.mark.parametrize("path", [".", ".."])
def test_a_session_is_named_from_within_as_from_outside(two, monkeypatch, capsys, path):
    """`.` and `..` give the same session to every tool: both parts, and a report in either."""
    first, second, _ = two
    below = first / "below"
    below.mkdir()
    monkeypatch.chdir(first if path == "." else below)
    session = sense4hri_session.open(path)
    assert [part.path.name for part in session.reader.parts] == [first.name, second.name]
    assert session.path.name == first.name
    assert main([path, "--list"]) == 0
    assert report([path, "--quiet"]) == report([path, "--quiet", "--only-this-part"]) == 0
    assert {json.loads((folder / "report.json").read_text())["folder"] for folder in (first, second)} == {first.name}
    capsys.readouterr()
    assert withdraw([path, "--human", "p1", "--dry-run"]) == 0
    assert capsys.readouterr().out.endswith("1 of 1 recordings hold something of p1\n")


def test_the_pause_is_a_gap_on_one_timeline(two):
    """Samples on both sides are where the unbroken recording has them, to 5 ms; a note tells how long nothing was."""
    first, second, whole = two
    session = sense4hri_session.open(first)
    found, truth = samples(first), samples(whole)
    truth = truth[truth["device_time_ns"].isin(found["device_time_ns"])]
    assert len(found) == len(truth)
    apart_s = (found.index - truth.index).total_seconds()
    assert abs(apart_s).max() < 0.005
    assert found.index.to_series().diff().max().total_seconds() > 1.0
    (note,) = [note for note in session.notes if "nothing was recorded" in note]
    assert first.name in note
    assert second.name in note
    assert 1.0 < float(note.split(" for ")[1].split(" s")[0]) < 2.0


def test_one_part_alone_says_that_there_are_others(two):
    """With only_this_part nothing of the other folder is read, and a note names it."""
    first, second, _ = two
    session = sense4hri_session.open(second, only_this_part=True)
    assert session.start_ns >= START_NS + TO_S * SECOND
    assert any(note.endswith(first.name) for note in session.notes)


@pytest.mark.parametrize("opened_ns", [START_NS, START_NS + 1], ids=["a copy", "a second recorder"])
def test_the_same_time_recorded_twice_is_read_once(study, short_study, opened_ns):
    """A copy of a folder beside it, and what a second recorder wrote, are no parts; the id alone names neither."""
    folder = short_study(study).write()
    again = folder.with_name(f"{folder.name}_1")
    shutil.copytree(folder, again)
    for path, opened in ((folder, START_NS), (again, opened_ns)):
        about = recorder_json.RecorderJson("complete", opened_ns=opened, closed_ns=START_NS + SECOND)
        about.session = {"session_id": "s1", "start_at_ns": START_NS}
        recorder_json.write(path, about)
        assert sum(record.topic == "/study/markers" for record in sense4hri_session.open(path).reader.messages()) == 3
    assert [parts(path) for path in (folder, again)] == [[folder], [again]]
    with pytest.raises(SessionError, match="is the session_id of 2 sessions, name one of them"):
        find(folder.parent / "s1")


def test_parts_that_overlap_are_told(study, short_study):
    """A part that begins before the end of one that was cut off: nobody knows why, so note and report say it."""
    short_study(study)
    everything = sorted(study.messages)
    for messages, state in ((everything, "interrupted"), (everything[len(everything) // 2 :], "complete")):
        folder = study.write(messages)
        session = {"session_id": "s1", "start_at_ns": START_NS}
        recorder_json.write(folder, recorder_json.RecorderJson(state, session=session))
    (note,) = [note for note in sense4hri_session.open(folder).notes if " is twice " in note]
    assert re.search(r"begins \d+\.\d s before .* ends", note)
    assert note in make_report(folder)["problems"]


def test_an_export_is_one_set_of_files(two, capsys):
    """Exporting any part writes one folder, named after the first, whose tables go over all parts."""
    first, second, _ = two
    assert main([str(second), "--formats", "csv", "--quiet"]) == 0
    out = first.with_name(f"{first.name}_export")
    assert capsys.readouterr().out.strip() == str(out)
    rows = pd.read_csv(out / "csv" / "p1_ecg_h10_1.csv")
    assert len(rows) == len(samples(first))
    about = json.loads((out / "session.json").read_text())
    assert [part["folder"] for part in about["parts"]] == [first.name, second.name]


def test_who_withdraws_from_a_later_part_is_in_no_export_of_the_session(two):
    """p1 is in the second folder only: the one export of both, which lies beside the first, goes all the same."""
    first, *_ = two
    assert withdraw([str(first), "--human", "p1", "--yes", "--quiet"]) == 0
    assert main([str(first), "--formats", "csv", "--quiet"]) == 0
    exported = first.with_name(f"{first.name}_export")
    assert (exported / "csv" / "p1_ecg_h10_1.csv").exists()
    assert withdraw([str(first.parent), "--human", "p1", "--yes", "--quiet"]) == 0
    assert list(first.parent.rglob("p1_*")) == []


def test_an_export_of_another_recording_beside_is_left(two):
    """Withdrawing from a part deletes no export that was made of other folders alone."""
    first, _, whole = two
    assert main([str(whole), "--formats", "csv", "--quiet"]) == 0
    assert withdraw([str(first), "--human", "p1", "--yes", "--quiet"]) == 0
    assert whole.with_name("whole_export").exists()


def test_a_damaged_part_is_named_and_can_be_left_out(two):
    """Where one part was cut off the session is refused with its file and the way round; alone the other one opens."""
    first, second, _ = two
    (file,) = second.glob("*.mcap")
    file.write_bytes(file.read_bytes()[:1000])
    with pytest.raises(SessionError, match=rf"{file.name}.*repair.*--only-this-part"):
        sense4hri_session.open(first)
    assert len(samples(first, only_this_part=True))


@pytest.mark.parametrize(
    ("one", "other", "together"),
    [
        ({}, {}, True),
        ({"session_id": "s2"}, {}, False),
        ({"start_ns": START_NS + SECOND}, {}, False),  # a session_id that was used again
        ({"start_ns": None}, {}, True),  # killed before the start was announced
    ],
)
def test_the_rule(two, one, other, together):
    """Parts have one session_id and one start; a start that is not known yet does not part them."""
    first, second, _ = two
    tell(first, **one)
    tell(second, **other)
    assert parts(first) == ([first, second] if together else [first])
    assert parts(second) == ([first, second] if together else [second])


def test_a_renamed_part_is_found_by_what_it_says(two):
    """A part that was given another name stays one, and a part without recorder.json is known by its name."""
    first, second, _ = two
    renamed = first.rename(first.with_name("monday"))
    assert parts(second) == [renamed, second]
    third = shutil.copytree(second, second.with_name(second.name.replace("_1", "_2")))
    (third / recorder_json.NAME).unlink()
    assert parts(second) == [renamed, second, third]


def test_a_name_that_fits_several_sessions_or_none_is_refused(two):
    """FOLDER/SESSION_ID with an id that was used twice names both sessions; an unknown one says so."""
    first, second, _ = two
    tell(second, start_ns=START_NS + SECOND)
    with pytest.raises(SessionError, match=f"2 sessions.*{first.name}.*{second.name}"):
        find(first.parent / "s1")
    with pytest.raises(SessionError, match="nor a session s9"):
        find(first.parent / "s9")
