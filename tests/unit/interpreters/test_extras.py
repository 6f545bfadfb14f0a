"""What interpreters put into `extra`: each name has its sentence for codebooks."""

import ast
from pathlib import Path

import pytest
from sense4hri import extras
from sense4hri.modalities import MODALITIES

SERVICES = Path(__file__).resolve().parents[3] / "services"
MESSAGES = {modality.message for modality in MODALITIES.values() if modality.message}


def names(folder: Path) -> set[str]:
    """First words of every `Feature(...)` in a service's code; what is put into a name is `x`."""
    calls = [node for file in folder.rglob("*.py") for node in ast.walk(ast.parse(file.read_text("utf-8")))]
    words = [node.args[0] for node in calls if isinstance(node, ast.Call) and ast.unparse(node.func) == "Feature"]
    parts = [word.values if isinstance(word, ast.JoinedStr) else [word] for word in words]
    texts = ["".join(p.value if isinstance(p, ast.Constant) else "x" for p in each) for each in parts]
    return {text for text in texts if text != "x"}


@pytest.mark.parametrize("service", sorted(path.name for path in SERVICES.glob("interpreter-*")))
def test_every_name_is_explained(service):
    """One of the messages here has a sentence for each; a name of nobody has the general one."""
    for name in names(SERVICES / service / "src"):
        told = {extras.about(message, name) for message in MESSAGES}
        assert told != {extras.OTHER}, name
    assert extras.about("EEG", "of_a_lab") == extras.about("Foo", "alpha_peak") == extras.OTHER
