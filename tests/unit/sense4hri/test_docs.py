"""What the guides show is what runs."""

import re
from pathlib import Path

import pytest
import study_file

ROOT = Path(__file__).resolve().parents[3]
GUIDES = {"adding-a-sensor.md": ("tests/kit/skinbox", "tests/kit/wristband")}


@pytest.mark.parametrize(("guide", "folders"), GUIDES.items())
def test_every_piece_of_code_in_a_guide_is_real(guide, folders):
    """Each block of Python or YAML stands, word for word, in one of the examples' files, which other tests run."""
    example = [path.read_text() for folder in folders for path in (ROOT / folder).iterdir() if path.is_file()]
    blocks = re.findall(r"```(?:python|yaml)\n(.*?)```", (ROOT / "docs" / guide).read_text(), re.S)
    assert blocks
    assert [block for block in blocks if not any(block in text for text in example)] == []


PAGES = [
    *ROOT.glob("*.md"),
    *(page for part in ("docs", "interfaces", "services") for page in (ROOT / part).rglob("*.md")),
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_relative_link_leads_somewhere(page):
    """What a page links to inside the repository is there."""
    prose = re.sub(r"```.*?```|`[^`\n]*`", "", page.read_text(), flags=re.S)
    links = re.findall(r"\]\(([^)\s#:]+)(?:#[^)\s]*)?\)", prose)
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize(("example", "sensor_id"), [("skinbox", "box_1"), ("wristband", "band_1")])
def test_the_study_of_the_guide_is_a_study(example, sensor_id):
    """The guide's study files are read by what starts a study, and their drivers are the guide's."""
    study = study_file.read(ROOT / "tests" / "kit" / example / "study.yaml")
    box = study.services[0]
    assert (study.participants, box.parameters["sensor_id"]) == (("p1",), sensor_id)
    driver = box.command[1].removeprefix("/driver/")
    assert (Path(box.mounts["/driver"]) / driver).is_file()
