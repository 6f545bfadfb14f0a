"""What Dockerfiles copy is sent to the Docker Engine, and can be read by the image's user."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
SENT = tuple(line[1:] for line in (ROOT / ".dockerignore").read_text().splitlines() if line.startswith("!"))
COPIED = [
    (file, source)
    for file in sorted(ROOT.glob("compose/*/Dockerfile"))
    for sources in re.findall(r"^COPY (?:--\S+ )?(.+) \S+$", file.read_text(), re.MULTILINE)
    for source in sources.split()
]


@pytest.mark.parametrize(("file", "source"), COPIED, ids=lambda one: str(one).rpartition("compose/")[2])
def test_what_a_dockerfile_copies_is_in_the_build_context(file, source):
    """It exists, and .dockerignore does not keep it back."""
    assert (ROOT / source).exists()
    assert any(Path(source).is_relative_to(sent) for sent in SENT), (
        f".dockerignore keeps {source} from {file.parent.name}"
    )


DOCKERFILES = [*ROOT.glob("compose/*/Dockerfile"), ROOT / "interfaces" / "Dockerfile", ROOT / "services" / "Dockerfile"]
BROUGHT = [
    (file.parent.name, line)
    for file in sorted(DOCKERFILES)
    for line in re.findall(r"^COPY .+", file.read_text().rpartition("\nFROM ")[2], re.MULTILINE)
    if "--from=" not in line
]


@pytest.mark.parametrize(("image", "line"), BROUGHT)
def test_what_an_image_brings_is_readable_whatever_the_umask_of_the_checkout(image, line):
    """Checked out under umask 077 the files are root's alone: programs of an image's user are 755, its files 644."""
    told = re.match(r"COPY --chmod=(\d+) ", line)
    assert told
    assert told[1] == ("755" if "/usr/local/bin/" in line else "644")


def test_an_image_of_each_kind_brings_something():
    """The lines above are found."""
    assert {image for image, _ in BROUGHT} == {"alertmanager", "interfaces", "prometheus", "tls"}
