"""docs/decisions: each page says since when it is in force, or what has taken its place."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "decisions"
PAGES = sorted(path for path in FOLDER.glob("*.md") if path.name != "README.md")
DATE = r"\d{4}-\d\d-\d\d"
STATUS = re.compile(rf"# .+\n\n\*(?:In force since {DATE}|Replaced on {DATE} by \[.+\]\((.+)\))\.\*\n\n")


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_a_decision_has_status_and_date(page):
    """Below its title, in the form that the folder's README gives; the page that replaces it is there."""
    found = STATUS.match(page.read_text())
    assert found is not None
    assert found[1] is None or (FOLDER / found[1]).is_file()
