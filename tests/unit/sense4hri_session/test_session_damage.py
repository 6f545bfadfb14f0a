"""Damaged and foreign recordings: one clear sentence, and nothing is harmed."""

import errno
import io
import os
import random
import shutil

import pytest
import sense4hri_session
import yaml
from sense4hri_recording import repair, source
from sense4hri_report import make_report
from sense4hri_session import SessionError
from sense4hri_session.__main__ import main


@pytest.fixture
def copy(recording, tmp_path):
    """A copy to damage: its folder and its file."""
    folder = shutil.copytree(recording, tmp_path / "copy")
    return folder, next(folder.glob("*.mcap"))


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 0.999])
def test_a_file_that_was_cut_off_names_itself_and_the_repair(copy, share):
    """A truncated file is refused with its name and the way to repair it, and stays as it is."""
    folder, file = copy
    whole = file.read_bytes()
    file.write_bytes(whole[: int(len(whole) * share)])
    cut = file.read_bytes()
    with pytest.raises(SessionError, match=rf"{file.name}.*(sense4hri-repair|no MCAP)"):
        sense4hri_session.open(folder)
    assert file.read_bytes() == cut


def test_after_the_repair_it_opens(copy):
    """What `sense4hri-repair` saves of a truncated file is a session again."""
    from sense4hri_recording.repair import main as repair

    folder, file = copy
    file.write_bytes(file.read_bytes()[:-2000])
    assert repair([str(folder)]) == 0
    assert len(sense4hri_session.open(folder)["p1/ecg/h10_1"].frame()) > 1000


def test_a_file_whose_name_is_no_utf8_is_told(copy, capsys):
    """metadata.yaml is written all the same, the repair names the file and ends with 1; nothing is a traceback."""
    folder, file = copy
    os.rename(file, os.path.join(os.fsencode(folder), b"\xff\xfe.mcap"))
    assert repair.main([str(folder)]) == 1
    assert repair.NAMELESS in capsys.readouterr().err
    assert yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["message_count"] > 0


def test_flipped_bits_are_found_or_do_not_matter(copy):
    """60 files with one byte changed: refused with a sentence, or exactly the same samples."""
    folder, file = copy
    whole = bytearray(file.read_bytes())
    truth = sense4hri_session.open(folder)["p1/ecg/h10_1"].frame()["ecg"].tolist()
    dice, refused = random.Random(5), 0
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[dice.randrange(len(damaged))] ^= 1 << dice.randrange(8)
        file.write_bytes(damaged)
        try:
            found = sense4hri_session.open(folder)["p1/ecg/h10_1"].frame()["ecg"].tolist()
        except SessionError:
            refused += 1
            continue
        assert found == truth
    assert refused > 40


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.mcap", b"SQLite format 3\0 and more", "sqlite3"),
        ("a.db3", b"SQLite format 3\0 and more", "sqlite3"),
        ("a.mcap", b"hello", "no MCAP"),
        ("a.mcap", b"", "no MCAP"),
        ("a.txt", b"", "no recording here"),
    ],
)
def test_foreign_files_are_refused(tmp_path, name, content, says):
    """Older rosbag2, text and empty files are each named for what they are."""
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SessionError, match=says):
        sense4hri_session.open(tmp_path)


def test_a_damaged_metadata_file_does_not_matter(copy):
    """Without a readable metadata.yaml the files beside it are read."""
    folder, _ = copy
    (folder / "metadata.yaml").write_bytes(b"\xff\xfe: [")
    assert len(sense4hri_session.open(folder).streams) == 4


def test_a_file_that_metadata_names_is_missing(copy):
    """A split that is gone is named."""
    folder, file = copy
    file.unlink()
    with pytest.raises(SessionError, match=rf"{file.name}.*not there"):
        sense4hri_session.open(folder)


def test_the_command_says_one_sentence_and_ends_with_1(tmp_path, capsys):
    """No traceback for what is not there, and nothing is written."""
    assert main([str(tmp_path / "nothing"), "--out", str(tmp_path / "out")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


class Failing(io.FileIO):
    """A file on a disk that can be read no further than its first 20 000 bytes."""

    def read(self, size: int = -1) -> bytes:
        if self.tell() > 20_000:
            raise OSError(errno.EIO, os.strerror(errno.EIO), self.name)
        return super().read(size)


def test_a_disk_that_fails_while_it_is_read_ends_the_report_in_a_sentence(copy, monkeypatch):
    """No part of a file is silently left out: the report names it and why, and none is made."""
    folder, file = copy

    look = source._look
    monkeypatch.setattr(
        source, "_look", lambda *about: look(*about) or monkeypatch.setattr(source, "open_file", Failing)
    )
    with pytest.raises(SessionError, match=f"{file.name} cannot be read: Input/output error"):
        make_report(folder)
    assert not (folder / "report.json").exists()
