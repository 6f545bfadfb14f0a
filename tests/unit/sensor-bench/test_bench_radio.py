"""The radio delivers in order, late as told, and loses what it is told to lose."""

import asyncio

import pytest
from processes import DEADLINE_S
from sensor_bench.ble.radio import LinkQuality, Radio
from sensor_bench.clock import HostClock

CLOCK = HostClock()


def sent(quality: LinkQuality, packets: int, interval_s: float = 0.002, stall_s: float = 0.0, seed: int = 1):
    """[(packet, delay in s, arrival in ns of CLOCK)] and the packets lost, for packets every interval_s."""
    arrived, lost = [], []

    async def use() -> None:
        radio = Radio(CLOCK, quality, seed)
        radio.open()
        if stall_s:
            radio.stall(stall_s)
        for number in range(packets):
            ready_ns = CLOCK.now_ns()

            async def deliver(number: int = number, ready_ns: int = ready_ns) -> None:
                now_ns = CLOCK.now_ns()
                arrived.append((number, (now_ns - ready_ns) * 1e-9, now_ns))

            radio.send(deliver, ready_ns, lambda number=number: lost.append(number), may_lose=True)
            await asyncio.sleep(interval_s)
        deadline = asyncio.get_running_loop().time() + DEADLINE_S
        while len(arrived) + len(lost) < packets and asyncio.get_running_loop().time() < deadline:
            await asyncio.sleep(0.01)
        radio.close()

    asyncio.run(use())
    return arrived, lost


def test_latency_and_order():
    """No packet is earlier than the latency, and jitter never lets one overtake another."""
    arrived, lost = sent(LinkQuality(latency_s=0.05, jitter_s=0.02), 60)
    assert [number for number, _, _ in arrived] == list(range(60))
    assert lost == []
    assert min(delay for _, delay, _ in arrived) >= 0.05


def test_connection_interval_is_a_grid_of_host_time():
    """With a connection interval no packet arrives before the next multiple of it."""
    grid_ns = 100_000_000
    quality = LinkQuality(latency_s=0.0, jitter_s=0.0, connection_interval_s=0.1)
    arrived, _ = sent(quality, 100)
    for _, delay_s, at_ns in arrived:
        ready_ns = at_ns - delay_s * 1e9
        assert at_ns >= -(-ready_ns // grid_ns) * grid_ns - 1000


def test_loss_is_what_the_seed_says():
    """A third of the packets is lost, the same ones for the same seed."""
    quality = LinkQuality(latency_s=0.0, jitter_s=0.0, loss=0.3)
    _, lost = sent(quality, 200, interval_s=0.0)
    _, again = sent(quality, 200, interval_s=0.0)
    assert lost == again
    assert len(lost) == pytest.approx(60, abs=20)


def test_a_stall_ends_in_a_burst():
    """What a stalled link holds back arrives when it is over and not before, in order."""
    begun_ns = CLOCK.now_ns()
    arrived, lost = sent(LinkQuality(latency_s=0.0, jitter_s=0.0), 20, interval_s=0.005, stall_s=0.4)
    assert lost == []
    assert [number for number, _, _ in arrived] == list(range(20))
    assert min(at_ns for _, _, at_ns in arrived) >= begun_ns + 0.4e9


def test_a_closed_link_loses_what_waits():
    """Packets under way when the link breaks are lost and counted."""
    lost = []

    async def use() -> None:
        radio = Radio(CLOCK, LinkQuality(latency_s=10.0), 1)
        radio.open()

        async def deliver() -> None:
            raise AssertionError("arrived")

        radio.send(deliver, CLOCK.now_ns(), lambda: lost.append("waiting"))
        radio.close()
        radio.send(deliver, CLOCK.now_ns(), lambda: lost.append("unconnected"))

    asyncio.run(use())
    assert lost == ["waiting", "unconnected"]
