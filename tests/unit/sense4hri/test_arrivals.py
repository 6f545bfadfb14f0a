"""From a device's library to its driver: order, stamps, silence, and a blocking read in a thread of its own."""

import asyncio
import queue
import selectors
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress

import pytest
from processes import DEADLINE_S
from sense4hri import arrivals
from sense4hri.arrivals import ASLEEP_S, AWAKE_S, Arrivals, Silence, from_thread
from sense4hri.errors import DeviceLost


def scenario(steps: Callable[[], Awaitable[None]]) -> None:
    """Run one asynchronous story to its end."""
    asyncio.run(asyncio.wait_for(steps(), DEADLINE_S))


class Waits(selectors.DefaultSelector):
    """Waits for nothing: its clock is put on by as long as it was to wait."""

    now_s = 1000.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self.now_s += timeout or 0.0
        return super().select(0)


class MadeUpTime(asyncio.SelectorEventLoop):
    """An event loop whose time passes by what it waits for, and by `stand`."""

    def __init__(self) -> None:
        self._waits = Waits()
        super().__init__(self._waits)

    def time(self) -> float:
        return self._waits.now_s

    def stand(self, seconds: float) -> None:
        """The process is stopped for so long."""
        self._waits.now_s += seconds

    def silence(self, streams: list[str], limit_s: float) -> Silence:
        return Silence(streams, limit_s, self.time)


def story(steps: Callable[[MadeUpTime], Awaitable[None]]) -> None:
    """Run one asynchronous story to its end in made-up time."""
    with asyncio.Runner(loop_factory=MadeUpTime) as runner:
        loop = runner.get_loop()
        assert isinstance(loop, MadeUpTime)
        runner.run(asyncio.wait_for(steps(loop), 3600.0))


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


async def sending(came: Arrivals[str], stream: str) -> None:
    """Something of a stream every tenth of a second."""
    while True:
        came.receive(stream)
        await asyncio.sleep(0.1)


def test_what_has_come_is_taken_together() -> None:
    """All that waits, each with its own stamp; nothing twice; the loss after it."""

    async def steps() -> None:
        came = Arrivals[int]()
        for number in (1, 2, 3):
            came.put(arrivals.Arrival(10 * number, number))
        came.fail(DeviceLost("unplugged"))
        assert await came.together() == [(10, 1), (20, 2), (30, 3)]
        with pytest.raises(DeviceLost, match="unplugged"):
            await came.together()

    scenario(steps)


async def listening(silence: Silence, came: Arrivals[str]) -> None:
    """What a driver does all the time."""
    while True:
        silence.broken_by((await silence.watch(came.get())).value)


def test_a_stream_that_falls_silent_beside_one_that_does_not() -> None:
    """The silent stream is named when its time has come, though others keep coming."""

    async def steps(loop: MadeUpTime) -> None:
        came, silence, begun_s = Arrivals[str](), loop.silence(["ecg", "accelerometer"], 3.0), loop.time()
        other = asyncio.ensure_future(sending(came, "accelerometer"))
        loop.call_at(begun_s + 2.05, came.receive, "ecg")
        with pytest.raises(DeviceLost, match="connected, but no ecg for 3 s"):
            await listening(silence, came)
        assert loop.time() - begun_s == pytest.approx(5.05)
        other.cancel()

    story(steps)


def test_what_has_come_already_is_no_silence() -> None:
    """A driver that was kept from reading for long reads what is waiting before it calls the device silent."""

    async def steps(loop: MadeUpTime) -> None:
        came, silence = Arrivals[str](), loop.silence(["ecg"], 3.0)
        came.receive("ecg")
        loop.stand(3.1)
        assert (await silence.watch(came.get())).value == "ecg"
        with pytest.raises(DeviceLost):
            await silence.watch(came.get())

    story(steps)


def test_what_comes_before_the_limit_counts_where_both_are_seen_at_once() -> None:
    """A process that was late by less than a stop finds the arrival and the limit together: nothing is lost."""

    async def steps(loop: MadeUpTime) -> None:
        came, silence = Arrivals[str](), loop.silence(["ecg"], 3.0)
        loop.call_later(2.9, came.receive, "ecg")
        loop.call_soon(loop.stand, 3.0 + ASLEEP_S / 2)
        assert (await silence.watch(came.get())).value == "ecg"

    story(steps)


def test_a_reader_that_is_cancelled_is_no_silence() -> None:
    """A driver that is told to stop ends as one that was cancelled, also in the moment in which the device is lost."""

    async def steps(loop: MadeUpTime) -> None:
        for told_s in (1.0, 3.0):
            came, silence = Arrivals[str](), loop.silence(["ecg"], 3.0)
            reader = asyncio.ensure_future(silence.watch(came.get()))
            loop.call_later(told_s, reader.cancel)
            with pytest.raises(asyncio.CancelledError):
                await reader
            assert reader.cancelled()

    story(steps)


def test_a_process_that_was_stopped_reads_first() -> None:
    """What came while nobody could look breaks the silence; a device that is silent still is lost a moment later."""

    async def steps(loop: MadeUpTime) -> None:
        came, silence = Arrivals[str](), loop.silence(["ecg"], 3.0)

        def stopped() -> None:
            loop.stand(3.0 + 2 * ASLEEP_S)
            loop.call_later(AWAKE_S / 2, came.receive, "ecg")  # the thread that reads was stopped too

        loop.call_soon(stopped)
        assert (await silence.watch(came.get())).value == "ecg"
        awake_s = loop.time() + 2 * ASLEEP_S
        loop.call_soon(loop.stand, 2 * ASLEEP_S)
        with pytest.raises(DeviceLost, match="no ecg"):
            await silence.watch(came.get())
        assert loop.time() <= awake_s + AWAKE_S

    story(steps)


def test_a_stream_that_stays_silent_after_a_stop_is_noticed_beside_one_that_sends() -> None:
    """The moment after a stop is waited for once, not anew with everything that comes of another stream."""

    async def steps(loop: MadeUpTime) -> None:
        came, silence = Arrivals[str](), loop.silence(["ecg", "accelerometer"], 3.0)
        other = asyncio.ensure_future(sending(came, "accelerometer"))
        loop.call_soon(loop.stand, 10.0)
        awake_s = loop.time() + 10.0
        with pytest.raises(DeviceLost, match="no ecg"):
            await listening(silence, came)
        assert loop.time() - awake_s == pytest.approx(AWAKE_S)
        other.cancel()

    story(steps)


def test_nothing_to_watch_is_waited_for_without_a_limit() -> None:
    """Where no stream sends all the time, silence means nothing."""

    async def steps(loop: MadeUpTime) -> None:
        came, silence = Arrivals[str](), loop.silence([], 0.0)
        loop.call_later(1000.0, came.receive, "battery")
        assert (await silence.watch(came.get())).value == "battery"

    story(steps)


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
