"""What Dockerfiles copy is sent to the Docker Engine."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
SENT = tuple(line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!"))
COPIED = [
    (file, source)
    for file in sorted(ROOT.glob("compose/*/Dockerfile"))
    for sources in re.findall(r"^COPY (.+) \S+$", file.read_text(), re.MULTILINE)
    for source in sources.split()
]


@pytest.mark.parametrize(("file", "source"), COPIED, ids=lambda one: str(one).rpartition("compose/")[2])
def test_what_a_dockerfile_copies_is_in_the_build_context(file, source):
    """It exists, and .dockerignore does not keep it back."""
    assert (ROOT / source).exists()
    assert any(Path(source).is_relative_to(sent) for sent in SENT), (
        f".dockerignore keeps {source} from {file.parent.name}"
    )
