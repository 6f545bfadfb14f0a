"""Other people's Polar libraries, unmodified, on the virtual sensors: the bench is not tuned to our own driver."""

import asyncio
import itertools

import pytest

pytest.importorskip("polar_python", reason="polar-python is not installed")
pytest.importorskip("bleakheart", reason="bleakheart is not installed")
from bleak import BleakClient, BleakScanner
from bleakheart import HeartRate, PolarMeasurementData
from polar_python import PolarDevice
from polar_python.constants import PmdMeasurementType

DEADLINE_S = 200.0


async def find(name: str):
    device = await BleakScanner.find_device_by_name(name, timeout=60)
    assert device is not None, f"{name} does not advertise"
    return device


async def collect(queue: asyncio.Queue, count: int) -> list:
    return [await asyncio.wait_for(queue.get(), DEADLINE_S) for _ in range(count)]


def test_polar_python_streams_ecg_and_acceleration_from_the_h10(bench):
    """polar-python reads the features and settings of the H10 and decodes its ECG, acceleration and heart rate."""

    async def use() -> None:
        ecg, acc, rate = asyncio.Queue(), asyncio.Queue(), asyncio.Queue()
        async with PolarDevice(await find("Polar H10 1A2B3C01")) as device:
            assert await device.get_available_features() == [PmdMeasurementType.ECG, PmdMeasurementType.ACC]
            settings = await device.request_stream_settings(PmdMeasurementType.ECG)
            assert [(s.type.name, s.values) for s in settings.settings] == [
                ("SAMPLE_RATE", [130]),
                ("RESOLUTION", [14]),
            ]
            await device.start_hr_stream(rate.put_nowait)
            await device.start_ecg_stream(ecg.put_nowait, sample_rate=130, resolution=14)
            await device.start_acc_stream(acc.put_nowait, sample_rate=100, resolution=16, range=4)
            frames = await collect(ecg, 5)
            assert [len(frame.data) for frame in frames] == [73] * 5
            values = [value for frame in frames for value in frame.data]
            assert 600 < max(values) < 1500  # an R wave of about a millivolt
            moved = await collect(acc, 2)
            x, y, z = moved[-1].data[0]
            assert abs((x * x + y * y + z * z) ** 0.5 - 1000) < 60
            beats = await collect(rate, 3)
            assert 55 < beats[-1].heartrate < 75
            await device.stop_ecg_stream()

    asyncio.run(asyncio.wait_for(use(), DEADLINE_S))


def test_polar_python_decodes_the_compressed_frames_of_the_verity_sense(bench):
    """polar-python decodes the delta-compressed PPG and acceleration of the Verity Sense."""

    async def use() -> None:
        ppg, acc = asyncio.Queue(), asyncio.Queue()
        async with PolarDevice(await find("Polar Sense 1A2B3C02")) as device:
            await device.start_ppg_stream(ppg.put_nowait, sample_rate=55, resolution=22, channels=4)
            await device.start_acc_stream(acc.put_nowait, sample_rate=52, resolution=16, range=8, channels=3)
            frames = await collect(ppg, 3)
            sample = frames[-1].samples[-1]
            assert 255_000 < sample[0] < 268_000
            assert -900 < sample[3] < -400
            moved = await collect(acc, 2)
            x, y, z = moved[-1].data[0]
            assert abs((x * x + y * y + z * z) ** 0.5 / 1000 - 1) < 0.06

    asyncio.run(asyncio.wait_for(use(), DEADLINE_S))


def test_bleakheart_streams_ecg_from_the_h10(bench):
    """bleakheart lists measurements and settings of the H10 and decodes its ECG and RR intervals."""

    async def use() -> None:
        ecg, beats = asyncio.Queue(), asyncio.Queue()
        async with BleakClient(await find("Polar H10 1A2B3C03")) as client:
            heart = HeartRate(client, queue=beats, unpack=False)
            await heart.start_notify()
            polar = PolarMeasurementData(client, ecg_queue=ecg)
            assert "ECG" in await polar.available_measurements()
            assert (await polar.available_settings("ECG"))["SAMPLE_RATE"] == [130]
            code, message, _ = await polar.start_streaming("ECG")
            assert (code, message) == (0, "SUCCESS")
            frames = await collect(ecg, 5)
            assert all(kind == "ECG" and len(samples) == 73 for kind, _, samples in frames)
            stamps = [stamp for _, stamp, _ in frames]
            steps_ms = [(b - a) / 1e6 for a, b in itertools.pairwise(stamps)]
            assert all(abs(step - 73 / 130 * 1e3) < 2 for step in steps_ms)  # rates differ from nominal by < 0.2 %
            assert (await polar.start_streaming("ECG"))[0] == 6  # already in state
            kind, _, (rate, intervals), _ = (await collect(beats, 3))[-1]
            assert kind == "HR"
            assert 70 < rate < 95
            assert all(600 < interval < 900 for interval in intervals)
            await polar.stop_streaming("ECG")

    asyncio.run(asyncio.wait_for(use(), DEADLINE_S))
