"""Damaged recordings through every tool that reads them: a sentence and a status, never a traceback, nothing harmed."""

import contextlib
import random
import shutil

import pytest
import sense4hri_session.__main__
from replay.bag import open_recording
from replay.recorded import BagError
from sense4hri_recording import repair
from sense4hri_session import withdraw

SEEDS = (*range(10), 128, 255, 288, 480)  # the last four once made a traceback


@pytest.fixture(scope="module")
def small(new_study, short_study):
    """A recording of a few seconds in several chunks, with everything that stands beside the file."""
    folder = short_study(new_study).write(flush_every=40)
    (folder / "recorder.json").write_text('{"format": 1, "state": "complete", "session": null, "topics": []}')
    return folder


def damage(folder, seed):
    """Cut off, flip or blank a part of one of the folder's files; returns its name and what was done."""
    dice = random.Random(seed)
    (bag,) = folder.glob("*.mcap")
    file = dice.choice([bag, bag, bag, bag, folder / "metadata.yaml", folder / "recorder.json"])
    content = bytearray(file.read_bytes())
    kind, at = dice.choice(["cut", "flip", "blank", "shout"]), dice.randrange(len(content))
    if dice.random() < 0.3:
        at = dice.choice([dice.randrange(min(64, len(content))), len(content) - 1 - dice.randrange(min(400, at + 1))])
    if kind == "cut":
        del content[at:]
    elif kind == "flip":
        content[at] ^= 1 << dice.randrange(8)
    else:
        length = dice.choice([1, 8, 64, 1024])
        content[at : at + length] = (b"\0" if kind == "blank" else b"\xff") * len(content[at : at + length])
    file.write_bytes(content)
    return f"{file.name}: {kind} at {at}"


def state(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("seed", SEEDS)
def test_no_tool_trips_over_damage(small, tmp_path, capsys, seed):
    """Export, replay, repair and withdrawal of a damaged recording end with 0 or 1; what is refused is as it was."""
    folder = shutil.copytree(small, tmp_path / "copy")
    what = damage(folder, seed)
    before = state(folder)

    def check(tool, status, whole_line):
        said = capsys.readouterr()
        assert status in (0, 1), (what, tool)
        assert "Traceback" not in said.err, (what, tool)
        if status:
            assert said.err.strip(), (what, tool)
            assert not whole_line or state(folder) == before, (what, tool)

    out = ["--out", str(tmp_path / "out"), "--formats", "csv", "xdf", "--quiet"]
    check("export", sense4hri_session.__main__.main([str(folder), *out]), True)
    assert state(folder) == before
    with contextlib.suppress(BagError), contextlib.closing(open_recording(folder)) as played:
        list(played.messages([topic.name for topic in played.topics], 0))
    assert state(folder) == before
    copy = shutil.copytree(folder, tmp_path / "to_repair")
    check("repair", repair.main([str(copy)]), False)
    for name, content in before.items():
        assert (copy / name).read_bytes() == content or name == "metadata.yaml", (what, name)
    check("withdraw", withdraw.main([str(folder), "--human", "p1", "--yes", "--quiet"]), True)
    if (copy / "metadata.yaml").exists():
        check("repaired", sense4hri_session.__main__.main([str(copy), "--list"]), False)
