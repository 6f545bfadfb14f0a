"""A recorder that writes numbered messages."""

import pytest
from numbered_writing import Study


@pytest.fixture
def study(tmp_path):
    study = Study(tmp_path)
    yield study
    study.writing.close()
