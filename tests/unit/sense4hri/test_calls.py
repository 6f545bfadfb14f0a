"""sense4hri.calls: what somebody waits for does not wait behind samples."""

import asyncio
from concurrent.futures import Future
from types import SimpleNamespace

from sense4hri.calls import Calls


def test_an_answer_does_not_wait_behind_what_waits_in_the_inbox():
    """An operator's order is acknowledged also while the main thread has messages of seconds before it."""

    async def ask() -> str:
        loop, waiting = asyncio.get_running_loop(), []
        answered: Future[str] = Future()
        client = SimpleNamespace(
            srv_name="/study/stop_session", service_is_ready=lambda: True, call_async=lambda request: answered
        )
        client.remove_pending_request = lambda pending: None
        post, soon = lambda *work: waiting.append(work), loop.call_soon_threadsafe
        calls = Calls(SimpleNamespace(), loop, post, loop.create_task, print, soon)
        asked = asyncio.ensure_future(calls.ask(client, "request", 1.0))
        await asyncio.sleep(0)
        answered.set_result("stopping")
        return await asked

    assert asyncio.run(ask()) == "stopping"
