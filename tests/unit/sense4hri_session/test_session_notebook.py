"""The notebook of docs/notebooks runs as it stands."""

import json
import os
import subprocess
import sys
from pathlib import Path

NOTEBOOK = Path(__file__).resolve().parents[3] / "docs" / "notebooks" / "session.ipynb"
RUN = """
import sys, nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], 4)
NotebookClient(notebook, timeout=100, kernel_name="python3").execute()
nbformat.write(notebook, sys.argv[2])
"""


def test_the_notebook_plots_and_computes(recording, tmp_path):
    """Every cell runs, one gives a picture, and the HRV of the synthetic heart is that of a metronome of 75 per min."""
    environment = {**os.environ, "SENSE4HRI_RECORDING": str(recording), "IPYTHONDIR": str(tmp_path / "ipython")}
    command = [sys.executable, "-c", RUN, str(NOTEBOOK), str(tmp_path / "done.ipynb")]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=115)
    assert done.returncode == 0, done.stderr[-3000:]
    cells = json.loads((tmp_path / "done.ipynb").read_text())["cells"]
    outputs = [output for cell in cells if cell["cell_type"] == "code" for output in cell["outputs"]]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    hrv = "".join(outputs[-1]["data"]["text/plain"])
    assert "heart rate in 1/min     75.0" in hrv
    assert "RMSSD in ms              0.0" in hrv
