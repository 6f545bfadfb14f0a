"""When the radio listens for advertisements: as long as anybody needs it."""

import asyncio
import contextlib
from collections.abc import AsyncIterator

from bumble.device import Device


class Listening:
    """Counts who needs the radio to listen, and switches it at the first and the last."""

    def __init__(self, central: Device) -> None:
        self._central = central
        self._needed, self._lock = 0, asyncio.Lock()

    async def need(self, change: int) -> None:
        """Count those who need scanning, +1 or -1: it begins with the first and ends with the last of them."""
        async with self._lock:
            was, self._needed = self._needed, self._needed + change
            if was == 0 and self._needed > 0:
                await self._central.start_scanning(filter_duplicates=False)
            elif was > 0 and self._needed == 0:
                await self._central.stop_scanning()

    @contextlib.asynccontextmanager
    async def on(self) -> AsyncIterator[None]:
        """Listen for the length of the context."""
        await self.need(+1)
        try:
            yield
        finally:
            await self.need(-1)
