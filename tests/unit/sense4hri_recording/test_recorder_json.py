"""recorder.json has one form, and whatever a file holds costs no more than what it would have told."""

import json

import pytest
from sense4hri_recording import recorder_json
from sense4hri_recording.recorder_json import FORMAT, NAME, RecorderJson


def test_what_is_written_is_read_again(tmp_path):
    """Every field comes back as it went in; neither trouble nor doubts are found in a complete recording."""
    topics = [{"topic": "/a", "type": "x/msg/Y", "messages": 3}]
    session = {"session_id": "s1", "start_at_ns": 5}
    told = RecorderJson("complete", "", session, "host", 1, 2, 3, {"recorder": "1"}, topics)
    recorder_json.write(tmp_path, told)
    found = recorder_json.read(tmp_path)
    assert found.as_json() == told.as_json()
    assert (found.session_id, found.start_at_ns, list(found.by_topic)) == ("s1", 5, ["/a"])
    assert (found.trouble, list(found.doubts(tmp_path))) == ("", [])


def test_a_newer_version_is_read_as_far_as_it_is_known_and_kept_whole(tmp_path):
    """Of a later format a sentence names both numbers; what it holds besides is there again after writing it anew."""
    newer = RecorderJson("complete").as_json() | {"format": FORMAT + 1, "weather": {"rain": True}}
    (tmp_path / NAME).write_text(json.dumps(newer))
    found = recorder_json.read(tmp_path)
    assert found.state == "complete"
    assert f"format {FORMAT + 1}, newer than {FORMAT}" in found.trouble
    assert any("newer" in doubt for doubt in found.doubts(tmp_path))
    recorder_json.write(tmp_path, found)
    assert json.loads((tmp_path / NAME).read_text()) == newer


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b'{"state": "complete"}', "has no format number"),
        (b'{"format": "one"}', "has no format number"),
        (b"[]", "not an object"),
        (b"", "cannot be read"),
        (b"\xff\xfe", "cannot be read"),
        (b"[" * 100_000, "cannot be read"),
        (None, "there is no recorder.json"),
    ],
)
def test_what_is_wrong_with_a_file_is_one_sentence(tmp_path, content, sentence):
    """Older, foreign, damaged or absent: reading never raises, and says which it was."""
    if content is not None:
        (tmp_path / NAME).write_bytes(content)
    assert sentence in recorder_json.read(tmp_path).trouble


def test_values_of_another_kind_are_left_out(tmp_path):
    """A number where a list belongs, a text where a time belongs: empty or None, and the rest stays."""
    wrong = {"format": FORMAT, "state": "interrupted", "why": 7, "session": 3, "opened_ns": "x", "topics": 3}
    (tmp_path / NAME).write_text(json.dumps(wrong | {"events": [1, {"what": "x"}], "software": []}))
    found = recorder_json.read(tmp_path)
    assert (found.session, found.session_id, found.opened_ns, found.topics, found.software) == (None, "", None, [], {})
    assert (found.why, found.events) == ("7", [{"what": "x"}])
    assert any("was interrupted: 7" in doubt for doubt in found.doubts(tmp_path))
