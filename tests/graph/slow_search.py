"""The recorder, on a disk so slow that looking for what was left behind takes until the file FOUND_AT is there."""

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from recorder import __main__ as recorder
from recorder.recover import left_behind


def slowly(root: Path) -> Iterator[Path]:
    while not Path(os.environ["FOUND_AT"]).exists():
        time.sleep(0.1)
    yield from left_behind(root)


if __name__ == "__main__":
    recorder.left_behind = slowly
    sys.exit(recorder.main())
