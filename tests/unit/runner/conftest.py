"""What the runner's own tests have run writes into their folder."""

import tempfile

import pytest


@pytest.fixture(autouse=True)
def scratch(tmp_path, monkeypatch):
    """Where test files that fail here leave what they wrote."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
