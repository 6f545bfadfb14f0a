"""How many questions one node is asked at a time."""

import asyncio
from collections import Counter
from types import SimpleNamespace

from sense4hri import discovery
from sense4hri.discovery import MOST_ASKED, RawStreams
from sense4hri.names import StreamName


def test_a_node_is_asked_a_few_questions_at_a_time(monkeypatch):
    """A mute node with fifty streams costs a few clients, and another node is asked meanwhile."""
    asking, most = Counter(), Counter()

    async def ask_parameters(service, node, names, timeout_s):
        asking[node] += 1
        most[node] = max(most[node], asking[node])
        most["both"] = max(most["both"], asking.total())
        await asyncio.sleep(0)
        asking[node] -= 1
        return {}

    async def ask_all():
        service = SimpleNamespace(subscribe=lambda *_, **__: None, watch=lambda *_, **__: None)
        streams = RawStreams(service, None, print, print)
        names = [StreamName("p1", "eog", f"flood_{number}") for number in range(50)]
        await asyncio.gather(*(streams._parameters(node, name) for node in ("/mute", "/other") for name in names))

    monkeypatch.setattr(discovery, "ask_parameters", ask_parameters)
    asyncio.run(ask_all())
    assert most == {"/mute": MOST_ASKED, "/other": MOST_ASKED, "both": 2 * MOST_ASKED}
