"""report.html: whole, of its own, and nothing that came over the graph is more than text."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest
from sense4hri_report import make_report, svg

SECOND = 1_000_000_000
START_NS = 1_700_000_000 * SECOND
EVIL = "</script></style></svg><script>alert(1)</script><img src=//x onerror='a'>\"'&amp;${}{{}}\u202e"
VOID = {"meta", "br", "img", "link", "input"}


class Tree(HTMLParser):
    """Tags in order, and whether every one is closed where it was opened."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.texts: dict[str, list[str]] = {}
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: Any) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.texts.setdefault(self.open[-1], []).append(data)


def build(study: Any, word: str) -> tuple[dict[str, Any], str]:
    """A session in which every name and text that others choose is `word`; returns report.json and the page."""
    header = {"stamp": {"sec": START_NS // SECOND, "nanosec": 0}, "frame_id": word}
    noise = np.random.default_rng(2)
    for i in range(120):
        if not 50 <= i < 60:
            log_ns = START_NS + i * SECOND // 10
            study.raw("p1/ecg/h10_1", log_ns, log_ns - 7 * SECOND, {word: noise.normal(0, 1, 13)})
    about = {"human_id": "p1", "sensor_type": "ecg", "sensor_id": "h10_1", "sampling_frequency_hz": 130.0}
    texts = ("vendor", "model", "serial_number", "firmware_version", "body_location", "unit", "host")
    sensor = about | {name: word for name in texts} | {"node": f"/{word}", "parameters_json": json.dumps({word: word})}
    study.add("/study/sensors", "SensorInfoArray", START_NS, header=header, sensors=[sensor])
    for i, name in enumerate(("note", word)):
        at = {"stamp": {"sec": START_NS // SECOND + 3 + i, "nanosec": 0}}
        told = {"name": name, "value": word, "source": word, "human_id": word}
        study.add("/study/markers", "Marker", START_NS + (3 + i) * SECOND, header=at, **told)
    told = {"session_id": word, "phase": 4, "detail": word, "study": word}
    study.add("/study/session", "SessionState", START_NS + 11 * SECOND, header=header, **told)
    for second in range(11):
        at = {"stamp": {"sec": START_NS // SECOND + second, "nanosec": 0}}
        told = {"host": word, "state": 3, "reasons": [word], "realtime_minus_monotonic_ns": 9 + SECOND * (second > 5)}
        topic = "/humans/physiological/p1/ecg/h10_1/health"
        study.add(topic, "StreamHealth", START_NS + second * SECOND, header=at, **told)
    folder = study.write()
    notes = json.loads((folder / "recorder.json").read_text())
    notes |= {"state": "interrupted", "why": word, "host": word, "software": {word: word}, "withheld": [word]}
    notes["session"] = {"session_id": word, "study": word, "task": word, "human_ids": [word], "metadata": {word: word}}
    notes["session"] |= {"required_streams": [word, "/study/markers"], "start_at_ns": START_NS, "stop_at_ns": None}
    notes["refused"] = [{"topic": word, "type": word, "why": word}]
    notes["nodes"] = [{"node": word, "parameters": {"software_version": word, word: {word: [word]}}}]
    notes["events"] = [{"at_ns": START_NS, "what": word}]
    notes["topics"][0]["losses"] = [{"after_ns": START_NS, "before_ns": START_NS, "count": 3, "cause": word}]
    (folder / "recorder.json").write_text(json.dumps(notes))
    return make_report(folder), (folder / "report.html").read_text()


@pytest.fixture(scope="module")
def plain(new_study):
    """report.json and the page of a session in which all names are `word`."""
    return build(new_study, "word")


def test_text_from_the_graph_stays_text(study, plain):
    """With script, tags, quotes and entities in every name and text, the page has the same elements as with a word."""
    summary, page = build(study, EVIL)
    tree, expected = Tree(page), Tree(plain[1])
    assert [tag for tag, _ in tree.tags] == [tag for tag, _ in expected.tags]
    assert [sorted(attributes) for _, attributes in tree.tags] == [
        sorted(attributes) for _, attributes in expected.tags
    ]
    assert tree.texts["script"] == expected.texts["script"]
    assert tree.texts["style"] == expected.texts["style"]
    assert not [name for _, attributes in tree.tags for name in attributes if name.startswith("on")]
    assert page.count("alert(1)") > 30  # it is all there, as text
    assert EVIL in summary["problems"][0] + summary["why"]


def test_the_page_needs_nothing_but_itself(plain):
    """No address of anything else is in it, no link, picture, font, style or script from elsewhere; all tags close."""
    page = plain[1]
    tree = Tree(page)
    assert tree.open == []
    found = {
        attributes[name] for _, attributes in tree.tags for name in ("src", "href", "action") if name in attributes
    }
    assert all(str(address).startswith("#s") for address in found)
    assert "url(" not in page
    assert "@import" not in page
    assert page.replace('xmlns="http://www.w3.org/2000/svg"', "").count("://") == 0


def test_page_and_json_tell_the_same(plain):
    """Verdict, reasons, gap, marker, parameter and step of the host's clock of report.json are words of the page."""
    summary, page = plain
    text = " ".join(" ".join(texts) for texts in Tree(page).texts.values())
    assert summary["verdict"] == "broken"
    said = [summary["why"], *summary["problems"], *summary["remarks"], *(rule["when"] for rule in summary["rules"])]
    for sentence in said:
        assert sentence[1:] in text
    (entry,) = (item for item in summary["streams"] if item["stream"] == "p1/ecg/h10_1")
    assert entry["gaps_total"] == 1
    assert "word: set by +1.000 s" in text
    assert {node["node"]: node["software_version"] for node in summary["nodes"]} == {"word": "word", "/word": None}


def test_the_page_does_not_grow_with_what_went_wrong(study):
    """1500 gaps are counted, the first are listed, and the page is still small enough to be sent to a colleague."""
    for i in range(3040):
        if i < 40 or i % 2:
            log_ns = START_NS + i * SECOND // 10
            study.raw("p1/ecg/h10_1", log_ns, log_ns - 7 * SECOND, {"ecg": np.full(13, float(i))})
    folder = study.write()
    (entry,) = make_report(folder)["streams"]
    assert (entry["gaps_total"], len(entry["gaps"]), entry["lost_samples"]) == (1500, 1500, 1500 * 13)
    assert (folder / "report.html").stat().st_size < 200_000


def test_of_a_long_list_the_first_ten_are_seen_and_the_others_are_folded(study):
    """58 notes: ten, and 48 more with a click or on paper; each is there once, in both lists."""
    for i in range(58):
        at = {"stamp": {"sec": START_NS // SECOND + i, "nanosec": 0}}
        study.add("/study/markers", "Marker", START_NS + i * SECOND, header=at, name="note", value=f"said {i:02d}.")
    make_report(folder := study.write())
    page = (folder / "report.html").read_text()
    for title in ("What happened", "Markers"):
        section = page.partition(f"<h2>{title}</h2>")[2].partition("</section>")[0]
        seen, _, folded = section.partition("<details><summary>and 48 more</summary>")
        assert [seen.count("said "), folded.count("said ")] == [10, 48]
        assert all(section.count(f"said {i:02d}.") == 1 for i in range(58))


@pytest.mark.filterwarnings("error")
def test_numbers_that_nobody_measures_are_not_drawn():
    """Infinite, or so large that their difference is: the path has the others, and nothing is said on the terminal."""
    values = np.array([1.0, 1.7e308, -1.7e308, np.inf, np.nan, 2.0])
    path, bottom, top = svg.envelope(values, values, np.zeros(6, bool), 0.0, 20.0)
    assert "nan" not in path
    assert 1.0 <= bottom < top <= 2.0
