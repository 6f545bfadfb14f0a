"""Lets the tests of this folder import what lies beside them, and look at a page as tests/browser does."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "browser"))

from gui_browser import chromium as chromium
