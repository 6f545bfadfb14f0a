"""Listens to a driver's device until what a test waits for has come."""

import asyncio
from collections.abc import AsyncIterable, Callable

from processes import DEADLINE_S
from sense4hri.device import Item


async def until(items: AsyncIterable[Item], found: Callable[[Item], object]) -> list[Item]:
    """Return all items up to the first for which found(item); TimeoutError at the deadline."""
    got = []
    async with asyncio.timeout(DEADLINE_S):
        async for item in items:
            got.append(item)
            if found(item):
                return got
    raise AssertionError("the stream has ended")
