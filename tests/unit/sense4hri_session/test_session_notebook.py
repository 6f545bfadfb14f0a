"""The notebook of docs/notebooks runs as it stands."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

NOTEBOOK = Path(__file__).resolve().parents[3] / "docs" / "notebooks" / "session.ipynb"
RUN = """
import sys, nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], 4)
where = {"metadata": {"path": sys.argv[3]}}
NotebookClient(notebook, timeout=300, kernel_name="python3", resources=where).execute()
nbformat.write(notebook, sys.argv[2])
"""


@pytest.mark.slow
def test_the_notebook_plots_and_computes(recording, tmp_path):
    """On the newest session every cell runs, one gives a picture, and HRV is right: a metronome of 75 per min."""
    where = tmp_path / "docs" / "notebooks"
    where.mkdir(parents=True)
    shutil.copytree(recording, tmp_path / "recordings" / "Test" / "p1-p2" / "s1_rest_20231114T221320Z")
    environment = {**os.environ, "IPYTHONDIR": str(tmp_path / "ipython")}
    environment.pop("SENSE4HRI_RECORDING", None)
    command = [sys.executable, "-c", RUN, str(NOTEBOOK), str(tmp_path / "done.ipynb"), str(where)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=400)
    assert done.returncode == 0, done.stderr[-3000:]
    cells = json.loads((tmp_path / "done.ipynb").read_text())["cells"]
    outputs = [output for cell in cells if cell["cell_type"] == "code" for output in cell["outputs"]]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    hrv = "".join(outputs[-1]["data"]["text/plain"])
    assert "heart rate in 1/min     75.0" in hrv
    assert "RMSSD in ms              0.0" in hrv
