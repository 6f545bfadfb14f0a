"""The recorder, one of whose threads hangs once a file is there: HANG names its class and method, HANG_AT the file."""

import os
import sys
import time
from pathlib import Path
from typing import Any

from recorder.__main__ import main
from recorder.hearing import Hearing
from recorder.writing import Writing
from sense4hri import liveness

liveness.HUNG_S = 6.0


def hang(kind: Any, method: str) -> None:
    work = getattr(kind, method)

    def hung(*arguments: Any) -> Any:
        while Path(os.environ["HANG_AT"]).exists():
            time.sleep(0.1)
        return work(*arguments)

    setattr(kind, method, hung)


if __name__ == "__main__":
    hang(*{"hearing": (Hearing, "_round"), "writing": (Writing, "_tend")}[os.environ["HANG"]])
    sys.exit(main())
