"""How many questions one node is asked at a time, and how often."""

import asyncio
from collections import Counter
from types import SimpleNamespace

from rclpy.exceptions import InvalidServiceNameException
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


def test_a_node_whose_name_is_none_keeps_nobody_waiting():
    """It cannot be asked, which shows at once: all else has its turn before it is tried again, and data are awaited."""
    tried = []

    def create_client(kind, name):
        tried.append(name)
        if len(tried) > 100:
            raise RuntimeError("nothing else has had its turn")
        raise InvalidServiceNameException(name, "of blanks", 3)

    async def follow():
        publisher = SimpleNamespace(endpoint_gid=b"1", node_namespace="/", node_name="no name")
        node = SimpleNamespace(get_publishers_info_by_topic=lambda topic: [publisher], create_client=create_client)
        loop, waits = asyncio.get_running_loop(), lambda *_, **__: None
        service = SimpleNamespace(node=node, subscribe=waits, watch=waits, start=loop.create_task)
        RawStreams(service, None, print, print)._begin(StreamName("p1", "ecg", "h10"), frozenset({b"1"}))
        while len(tried) < 3:
            await asyncio.sleep(0.01)

    asyncio.run(asyncio.wait_for(follow(), 30))
    assert len(tried) < 10
