"""What the guides show is what runs."""

import re
from pathlib import Path

import pytest
import study_file

ROOT = Path(__file__).resolve().parents[3]
GUIDES = {"adding-a-sensor.md": "tests/kit/skinbox"}


@pytest.mark.parametrize(("guide", "folder"), GUIDES.items())
def test_every_piece_of_code_in_a_guide_is_real(guide, folder):
    """Each block of Python or YAML stands, word for word, in one of the example's files, which other tests run."""
    example = [path.read_text() for path in (ROOT / folder).iterdir() if path.is_file()]
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


def test_the_study_of_the_guide_is_a_study():
    """The guide's study file is read by what starts a study, and its driver is the guide's."""
    study = study_file.read(ROOT / "tests" / "kit" / "skinbox" / "study.yaml")
    box = study.services[0]
    assert (study.participants, box.parameters["sensor_id"]) == (("p1",), "box_1")
    driver = box.command[1].removeprefix("/driver/")
    assert (Path(box.mounts["/driver"]) / driver).is_file()
