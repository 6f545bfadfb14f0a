"""The queue to the main thread: order, what may be dropped and what never is."""

import asyncio

from sense4hri.inbox import Inbox


def made(fill, most_samples=3, most_bytes=1000):
    """What an inbox calls, in order, after fill(inbox) has run; and how often it dropped."""
    got, drops = [], []

    async def work():
        inbox = Inbox(asyncio.get_running_loop(), lambda: drops.append(1), most_samples, most_bytes)
        fill(inbox, got)
        while inbox._scheduled:
            await asyncio.sleep(0)

    asyncio.run(work())
    return got, len(drops)


def test_calls_are_made_in_the_order_in_which_they_came():
    """Samples and everything else stay in one order."""

    def fill(inbox, got):
        for n in range(6):
            inbox.put(got.append, n, droppable_bytes=None if n % 2 else 8)

    assert made(fill) == ([0, 1, 2, 3, 4, 5], 0)


def test_a_full_queue_drops_the_oldest_samples_and_nothing_else():
    """A session's phase put in before a thousand samples is still there, and in its place; what is lost is counted."""

    def fill(inbox, got):
        inbox.put(got.append, "sample 0", droppable_bytes=8)
        inbox.put(got.append, "PREPARING")
        for n in range(1, 1000):
            inbox.put(got.append, f"sample {n}", droppable_bytes=8)
            if n == 998:
                inbox.put(got.append, "assignment")

    got, drops = made(fill)
    assert got == ["PREPARING", "sample 997", "sample 998", "assignment", "sample 999"]
    assert drops == 997


def test_few_large_samples_take_no_more_room_than_many_small_ones():
    """Of samples that are too large together the oldest go, as many as must; those handled leave their room."""

    def fill(inbox, got):
        for n, size in enumerate((300, 300, 300, 900)):
            inbox.put(got.append, n, droppable_bytes=size)
        inbox.put(lambda: inbox.put(got.append, "later", droppable_bytes=1000))

    assert made(fill, most_samples=100) == ([3, "later"], 3)


def test_what_is_kept_has_no_limit():
    """Ten times as many kept calls as samples may wait are all made."""
    got, drops = made(lambda inbox, got: [inbox.put(got.append, n) for n in range(30)])
    assert (got, drops) == (list(range(30)), 0)


def test_a_call_may_put_in_another_one():
    """What a call puts in is made after what was waiting already."""

    def fill(inbox, got):
        inbox.put(lambda: (got.append("first"), inbox.put(got.append, "third")))
        inbox.put(got.append, "second")

    assert made(fill)[0] == ["first", "second", "third"]


def test_other_tasks_have_their_turn_while_much_waits():
    """A backlog does not keep the rest of the service waiting until it is worked off."""

    async def work():
        inbox, seen = Inbox(asyncio.get_running_loop(), lambda: None), []

        def again():
            seen.append(1)
            inbox.put(again)

        inbox.put(again)
        await asyncio.wait_for(asyncio.sleep(0), 60)
        await asyncio.wait_for(asyncio.sleep(0), 60)
        return seen

    assert asyncio.run(work())


def test_what_comes_after_the_end_is_no_error():
    """The ROS thread may hand over after the loop has closed."""
    loop = asyncio.new_event_loop()
    inbox = Inbox(loop, lambda: None)
    loop.close()
    inbox.put(print, "late")


def test_what_waits_when_it_is_closed_is_not_made():
    """A call that would work on what is being taken down is never made, nor is one that comes later."""

    def fill(inbox, got):
        inbox.put(lambda: (got.append("last"), inbox.close(), inbox.put(got.append, "later")))
        inbox.put(got.append, "waiting")
        inbox.put(got.append, "sample", droppable_bytes=8)

    assert made(fill) == (["last"], 0)
