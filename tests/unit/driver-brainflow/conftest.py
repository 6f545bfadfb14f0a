"""What a Board leaves behind in a process that is to end, taken back in one that goes on."""

import atexit
import os

import pytest


@pytest.fixture(autouse=True)
def process_that_goes_on():
    """A Board whose BrainFlow hangs has the process end with its status, here that of all tests."""
    yield
    atexit.unregister(os._exit)
