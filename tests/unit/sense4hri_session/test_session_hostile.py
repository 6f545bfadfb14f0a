"""Damaged and hostile recordings through every tool: a sentence within a time, never a traceback, nothing harmed.

The full form, a thousand mutations, is `tests/bench/bench_hostile_recordings.py`.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "hostile" / "tools.py"
MUTATIONS = [
    "chunk_lies",
    "record_length_lies",
    "index_lies",
    "statistics_lie",
    "zstd_bomb",
    "chunk_indexed_often",
    "receipts",
    "header_stamps",
    "device_stamps",
    "cdr_cut",
    "cdr_numbers",
    "cdr_lengths",
    "json_in_messages",
    "type_names",
    "definitions",
    "definitions_damaged",
    "topics",
    "channel_metadata",
    "encodings",
    "recorder_json",
    "report_json",
    "metadata_yaml",
    "journal",
    "file_names",
    "odd_files",
]


@pytest.mark.slow
def test_no_tool_trips_over_a_hostile_recording():
    """Six tools, every mutation: they end within 20 s and 1 GB with a sentence, and the input is as it was."""
    command = [sys.executable, str(TOOLS), "--seeds", "0:1", "--only", *MUTATIONS]
    env = os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False, timeout=560)
    found = json.loads(done.stdout)
    assert found["wrong"] == []
    assert found["ran"] == 6 * len(MUTATIONS)
