"""Work for a child process: neurokit2 costs seconds and 240 MB to import, which the bench would keep for good."""

import asyncio
import json
import sys
from typing import Any

TIMEOUT_S = 120.0


class ChildError(RuntimeError):
    """The child failed; the message is the last line it wrote."""


async def result_of(module: str, *arguments: str) -> Any:
    """The JSON that `python -m module arguments` prints; the child ends with the caller."""
    command = (sys.executable, "-m", module, *arguments)
    try:
        child = await asyncio.create_subprocess_exec(
            *command, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
        )
    except OSError as err:
        raise ChildError(f"{module} cannot be started: {err}") from err
    try:
        async with asyncio.timeout(TIMEOUT_S):
            output, errors = await child.communicate()
    finally:
        if child.returncode is None:
            child.kill()
            await child.wait()
    if child.returncode != 0:
        raise ChildError((errors.decode(errors="replace").strip().splitlines() or [f"{module} failed"])[-1])
    return json.loads(output)
