"""The page's building blocks, without a browser: run by Node where it is installed."""

import shutil
import subprocess
from importlib.resources import files

import pytest
from processes import DEADLINE_S

NODE = shutil.which("node")
TWICE = """
import { keyed } from "./dom.mjs";

class Parent {
  children = [];
  get firstElementChild() { return this.children[0] ?? null; }
  insertBefore(child, place) {
    child.remove();
    this.children.splice(place ? this.children.indexOf(place) : this.children.length, 0, child);
  }
}

class Child {
  get nextElementSibling() { return parent.children[parent.children.indexOf(this) + 1] ?? null; }
  remove() { parent.children = parent.children.filter((one) => one !== this); }
}

globalThis.document = {};
const parent = new Parent();
for (const items of ["ab", "aab", "aab", "baa", "baa"]) {
  keyed(parent, [...items], (item) => item, () => new Child(), () => {});
}
console.log(parent.children.map((child) => child.key).join(""));
"""


@pytest.mark.skipif(NODE is None, reason="Node is not installed")
def test_what_is_told_twice_does_not_grow_on_the_page(tmp_path):
    """A stream that is required twice, a reason given twice: two rows, however often they are told."""
    shutil.copy(files("web_gui") / "static" / "js" / "dom.js", tmp_path / "dom.mjs")
    (tmp_path / "twice.mjs").write_text(TWICE)
    ran = subprocess.run(
        [NODE, "twice.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=DEADLINE_S, check=True
    )
    assert ran.stdout.split() == ["baa"]
