"""What a report says of damaged files."""

from __future__ import annotations

import contextlib
import random
import shutil
from pathlib import Path

import pytest
from reported_session import ECG, ECG_TOPIC, entry, finish, health, rewritten, stream, told
from sense4hri_report import make_report
from sense4hri_report.__main__ import main
from sense4hri_session import SessionError


@pytest.fixture(scope="module")
def whole(new_study):
    """A folder to copy and damage."""
    stream(new_study, ECG, without=range(100, 110))
    for second in range(30):
        health(new_study, ECG, second, 5)
    return finish(new_study, session=told(required_streams=[ECG_TOPIC]))


def copied(whole: Path, target: Path) -> tuple[Path, Path, bytes]:
    folder = shutil.copytree(whole, target / whole.name)
    (file,) = folder.glob("*.mcap")
    return folder, file, file.read_bytes()


@pytest.mark.parametrize("share", [0.001, 0.3, 0.5, 0.7, 0.9999])
def test_a_file_that_was_cut_off_has_a_report_of_what_is_there(whole, tmp_path, share):
    """The report names the file that was cut off, and whether that cost messages."""
    folder, file, content = copied(whole, tmp_path)
    file.write_bytes(content[: int(len(content) * share)])
    summary = make_report(folder)
    found = sum(item.get("samples", 0) for item in summary["streams"])
    assert found == 330 * 13 if share > 0.99 else found < 300 * 13
    assert any(file.name in said for said in summary["problems" if share < 0.99 else "remarks"])
    assert (found < 150 * 13) == (summary["verdict"] == "broken")


def test_a_file_without_content_is_an_error_that_names_it(whole, tmp_path):
    """Where no file of a folder is a recording there is no report, and the error says which file is none."""
    folder, file, _ = copied(whole, tmp_path)
    file.write_bytes(b"")
    with pytest.raises(SessionError, match=f"{file.name} is no MCAP file"):
        make_report(folder)


def test_flipped_bits_never_end_in_a_traceback_or_a_lie(whole, tmp_path):
    """80 files with eight changed bytes: a sentence or a report, and a report without trouble counts what is true."""
    folder, file, content = copied(whole, tmp_path)
    truth = entry(make_report(folder), ECG)
    dice, reports = random.Random(6), 0
    for _ in range(80):
        damaged = bytearray(content)
        for _ in range(8):
            damaged[dice.randrange(len(damaged))] ^= 1 << dice.randrange(8)
        file.write_bytes(damaged)
        try:
            summary = make_report(folder)
        except SessionError:
            continue
        reports += 1
        if not summary["recording"]["trouble"] and summary["verdict"] != "broken":
            found = entry(summary, ECG)
            assert [found[key] for key in ("samples", "gaps", "duplicates")] == [
                truth[key] for key in ("samples", "gaps", "duplicates")
            ]
    assert reports > 40


def test_a_damaged_message_or_definition_never_ends_in_a_traceback(whole, tmp_path):
    """30 files without chunks, and so without checksums, with 40 changed bytes: a sentence or a report of the rest."""
    folder, _, _ = copied(whole, tmp_path)
    rewritten(folder, use_chunking=False, enable_crcs=False)
    file, dice, reports = folder / "bag_0.mcap", random.Random(7), 0
    content = file.read_bytes()
    begin = content.index(b"StreamHealth") - 100
    for number in range(30):
        damaged = bytearray(content)
        for _ in range(40):
            damaged[dice.randrange(begin, begin + 8000 if number % 2 else len(damaged))] = dice.randrange(256)
        file.write_bytes(damaged)
        with contextlib.suppress(SessionError):
            reports += make_report(folder)["format"]
    assert reports > 15


@pytest.mark.parametrize("content", ["", "{", "[]", '{"topics": 3, "session": [], "nodes": [1], "events": {}}'])
def test_a_damaged_recorder_json_costs_only_what_it_told(whole, tmp_path, content):
    """The samples are judged, and the report says what is not known."""
    folder, _, _ = copied(whole, tmp_path)
    (folder / "recorder.json").write_text(content)
    summary = make_report(folder)
    assert entry(summary, ECG)["gaps_total"] == 1
    assert any("recorder.json" in remark for remark in summary["remarks"])


def test_the_command_says_what_it_cannot_report_on_and_goes_on(whole, tmp_path, capsys):
    """Of three folders, one is none and one cannot be written to: two sentences, one report, exit status 1."""
    folder, file, _ = copied(whole, tmp_path)
    blocked, _, _ = copied(whole, tmp_path / "b")
    (blocked / "report.html").mkdir()
    assert main([str(tmp_path / "none"), str(blocked), str(folder)]) == 1
    said = capsys.readouterr()
    assert "there is no such file or directory" in said.err
    assert f"{blocked / 'report.html'} cannot be written" in said.err
    assert said.out.startswith(f"{folder / 'report.html'}: usable with gaps: ")
    assert sorted(path.name for path in blocked.glob(".report*")) == []
    assert main([str(file)]) == 1
    assert "is a file" in capsys.readouterr().err
