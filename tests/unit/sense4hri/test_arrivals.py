"""From a device's library to its driver: order, stamps, silence, and a blocking read in a thread of its own."""

import asyncio
import queue
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest
from processes import DEADLINE_S
from sense4hri import arrivals
from sense4hri.arrivals import Arrivals, Silence, from_thread
from sense4hri.errors import DeviceLost


def scenario(steps: Callable[[], Awaitable[None]]) -> None:
    """Run one asynchronous story to its end."""
    asyncio.run(asyncio.wait_for(steps(), DEADLINE_S))


def device_threads() -> int:
    return sum(thread.name == "device" for thread in threading.enumerate())


def test_a_loss_is_read_after_everything_before_it() -> None:
    """What had come is handed over first, with its stamp; after the loss nothing more is taken."""

    async def steps() -> None:
        came, before_ns = Arrivals[int](), time.time_ns()
        came.receive(1)
        came.receive(2)
        came.fail(DeviceLost("unplugged"))
        came.fail(DeviceLost("something that followed from it"))
        came.receive(3)
        read = [await came.get(), await came.get()]
        assert [value for _, value in read] == [1, 2]
        assert before_ns <= read[0].received_ns <= read[1].received_ns <= time.time_ns()
        for _ in range(2):
            with pytest.raises(DeviceLost, match="unplugged"):
                await came.get()

    scenario(steps)


def test_a_reader_that_falls_behind_loses_the_oldest() -> None:
    """The queue is bounded, the oldest goes, and a loss is never what is dropped."""

    async def steps() -> None:
        came = Arrivals[int](3)
        for number in range(5):
            came.receive(number)
        came.fail(DeviceLost("unplugged"))
        assert [(await came.get()).value for _ in range(3)] == [2, 3, 4]
        with pytest.raises(DeviceLost):
            await came.get()

    scenario(steps)


def test_a_stream_that_falls_silent_beside_one_that_does_not() -> None:
    """The silent stream is named, though others keep coming."""

    async def steps() -> None:
        came, silence = Arrivals[str](), Silence(["ecg", "accelerometer"], 0.1)

        async def send() -> None:
            while True:
                came.receive("accelerometer")
                await asyncio.sleep(0.01)

        sending = asyncio.ensure_future(send())

        async def listen() -> None:
            while True:
                silence.broken_by((await silence.watch(came.get())).value)

        with pytest.raises(DeviceLost, match=r"connected, but no ecg for 0\.1 s"):
            await listen()
        sending.cancel()

    scenario(steps)


def test_what_has_come_already_is_no_silence() -> None:
    """A driver that was kept from reading for long reads what is waiting before it calls the device silent."""

    async def steps() -> None:
        came, silence = Arrivals[str](), Silence(["ecg"], 0.0)
        came.receive("ecg")
        assert (await silence.watch(came.get())).value == "ecg"
        with pytest.raises(DeviceLost):
            await silence.watch(came.get())

    scenario(steps)


def test_a_process_that_was_stopped_reads_first(monkeypatch: pytest.MonkeyPatch) -> None:
    """What came while nobody could look breaks the silence; a device that is silent still is lost a moment later."""
    monkeypatch.setattr(arrivals, "ASLEEP_S", 0.05)
    monkeypatch.setattr(arrivals, "AWAKE_S", 0.5)

    async def steps() -> None:
        loop, came, silence = asyncio.get_running_loop(), Arrivals[str](), Silence(["ecg"], 0.02)

        def stopped() -> None:
            time.sleep(0.2)
            loop.call_later(0.01, came.receive, "ecg")  # the thread that reads was stopped too

        loop.call_soon(stopped)
        assert (await silence.watch(came.get())).value == "ecg"
        loop.call_soon(time.sleep, 0.2)
        with pytest.raises(DeviceLost, match="no ecg"):
            await silence.watch(came.get())

    scenario(steps)


def test_a_stream_that_stays_silent_after_a_stop_is_noticed_beside_one_that_sends(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The moment after a stop is waited for once, not anew with everything that comes of another stream."""
    monkeypatch.setattr(arrivals, "ASLEEP_S", 0.1)
    monkeypatch.setattr(arrivals, "AWAKE_S", 0.2)

    async def steps() -> None:
        came, silence = Arrivals[str](), Silence(["ecg", "accelerometer"], 0.02)

        async def send() -> None:
            while True:
                came.receive("accelerometer")
                await asyncio.sleep(0.01)

        sending = asyncio.ensure_future(send())
        asyncio.get_running_loop().call_soon(time.sleep, 0.2)

        async def listen() -> None:
            for _ in range(500):
                silence.broken_by((await silence.watch(came.get())).value)

        with pytest.raises(DeviceLost, match="no ecg"):
            await listen()
        sending.cancel()

    scenario(steps)


def test_nothing_to_watch_is_waited_for_without_a_limit() -> None:
    """Where no stream sends all the time, silence means nothing."""

    async def steps() -> None:
        came, silence = Arrivals[str](), Silence([], 0.0)
        asyncio.get_running_loop().call_later(0.05, came.receive, "battery")
        assert (await silence.watch(came.get())).value == "battery"

    scenario(steps)


def test_a_blocking_read_becomes_an_iterator() -> None:
    """Every value comes once, in order, stamped when the read returned and not when it was looked at."""
    source: queue.Queue[int | None] = queue.Queue()

    async def steps() -> None:
        async with from_thread(source.get, lambda: source.put(None)) as came:
            for number in (1, None, 2, 3):
                source.put(number)
            first = await anext(came)
            while not source.empty():
                await asyncio.sleep(0.001)
            looked_ns = time.time_ns()
            rest = [await anext(came), await anext(came)]
            assert [first.value, *(each.value for each in rest)] == [1, 2, 3]
            assert rest[0].received_ns < looked_ns
        assert device_threads() == 0

    scenario(steps)


@pytest.mark.parametrize("failure", [DeviceLost("the cable is out"), ZeroDivisionError("a mistake in the driver")])
def test_what_the_read_raises_is_raised_where_it_is_read(failure: Exception) -> None:
    """A loss is a loss, a mistake is that mistake; both after what had been read before."""
    values = iter([7, 8])

    def read() -> int:
        for value in values:
            return value
        raise failure

    async def steps() -> None:
        seen: list[int] = []

        async def listen() -> None:
            async with from_thread(read) as came:
                while True:
                    seen.append((await came.get()).value)

        with pytest.raises(type(failure), match=str(failure)):
            await listen()
        assert seen == [7, 8]
        assert device_threads() == 0

    scenario(steps)


def test_cancelling_interrupts_the_read_and_ends_the_thread() -> None:
    """A read that waits for ever is interrupted when the driver is stopped; nobody reads any more."""
    source: queue.Queue[int | None] = queue.Queue()

    async def listen() -> None:
        async with from_thread(source.get, lambda: source.put(None)) as came:
            await came.get()

    async def steps() -> None:
        task = asyncio.ensure_future(listen())
        while device_threads() == 0:
            await asyncio.sleep(0.001)
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        assert task.cancelled()
        assert device_threads() == 0

    scenario(steps)


def test_a_read_that_cannot_be_ended_is_no_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    """Closing does not wait for ever, and says that the port is still held."""
    monkeypatch.setattr(arrivals, "CLOSE_S", 0.05)
    source: queue.Queue[int] = queue.Queue()

    async def steps() -> None:
        with pytest.raises(RuntimeError, match=r"has not returned 0\.05 s after"):
            async with from_thread(source.get):
                pass
        source.put(1)

    scenario(steps)
