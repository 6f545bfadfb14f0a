"""driver-brainflow as a process, through unmodified BrainFlow: a virtual Muse 2 over SimpleBLE, a Shimmer3 on a pty."""

import pytest
from processes import poll
from rcl_interfaces.srv import GetParameters
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri_msgs.msg import PhysioRaw, StreamHealth
from sensor_bench_process import BenchProcess

DEVICES = """
participants: {p1: {}}
devices:
  - {sensor: muse_1, model: Muse2, participant: p1, address: "00:55:DA:B0:00:01", counter_start: 65520, down: DOWN}
"""
ADDRESS = "00:55:DA:B0:00:01"
EEG, GYROSCOPE = StreamName("p1", "eeg", "muse_1"), StreamName("p1", "gyroscope", "muse_1")
FIRST = {"eeg": 12, "gyroscope": 3}  # BrainFlow waits for a second packet before it hands out any


@pytest.fixture
def begin(tmp_path, ros_domain):
    """begin() starts a bench with one headband, on a bus that is not there before; down: it is switched off."""
    running = []

    def begun(down="false"):
        running.append(BenchProcess(tmp_path, devices=DEVICES.replace("DOWN", down), ros4hri=False).until_ready())
        return running[-1]

    yield begun
    for one in running:
        one.end()


@pytest.fixture
def bench(begin):
    """A bench with one headband."""
    return begin()


def sent(bench: BenchProcess, sensor_type: str) -> tuple[int, int]:
    """Samples that came through and that were lost, by the bench's truth."""
    counts = bench.read("/truth")["devices"]["muse_1"]["streams"].get(sensor_type, {})
    return counts.get("samples_sent", 0), counts.get("samples_lost", 0)


def test_a_muse_goes_the_whole_way(bench, start, ears):
    """Losses are counted to the sample across the counter's wrap; one that was away is back; SIGTERM halts it."""
    raw = ears.hear(PhysioRaw, EEG.topic("raw"), qos.deep(qos.RAW))
    health = {name.sensor_type: ears.hear(StreamHealth, name.topic("health"), qos.HEALTH) for name in (EEG, GYROSCOPE)}
    driver = start(
        "driver_brainflow",
        env={"DBUS_SYSTEM_BUS_ADDRESS": bench.address},
        sensor_id="muse_1",
        human_id="p1",
        board="MUSE_2",
        mac_address=ADDRESS,
        streams=["eeg", "gyroscope"],
    )
    driver.until("streaming")
    bench.post("/devices/muse_1/knobs", loss=0.2)
    ears.until(lambda: sent(bench, "eeg")[1] >= 10 * 12 and sent(bench, "eeg")[0] > 40 * 12, "losses past the wrap", 60)
    bench.post("/devices/muse_1/knobs", loss=0.0)

    def told(sensor_type: str) -> bool:
        """The driver has counted every loss, and holds what came less what was on the way just now."""
        (came, lost), last = sent(bench, sensor_type), health[sensor_type][-1]
        return last.lost_samples_total == lost and 0 <= came - FIRST[sensor_type] - last.samples_total <= 512

    ears.until(lambda: all(told(each) for each in health), "every loss in health", 30)
    assert [each.channel_name for each in raw[-1].channels] == ["TP9", "AF7", "AF8", "TP10"]
    assert all(message.device_timestamp.sec == 0 for message in raw)
    bench.post("/devices/muse_1/knobs", down=True)
    ears.until(lambda: "no samples for 2 s" in " ".join(health["eeg"][-1].reasons), "the headband is missed", 40)
    assert health["eeg"][-1].state != StreamHealth.STREAMING
    bench.post("/devices/muse_1/knobs", down=False)
    ears.until(lambda: health["eeg"][-1].state == StreamHealth.STREAMING, "streaming again", 60)
    assert health["eeg"][-1].reconnects_total == 1
    assert driver.stop() == 0
    poll(lambda: bench.read("/devices")[0]["streaming"] == [], "the headband was told to stop")


def test_a_board_that_is_late_is_waited_for(begin, start, ears, tmp_path):
    """No Bluetooth, then no headband, then both: health says why each search failed, and the next one is made."""
    health = ears.hear(StreamHealth, EEG.topic("health"), qos.HEALTH)
    driver = start(
        "driver_brainflow",
        env={"DBUS_SYSTEM_BUS_ADDRESS": f"unix:path={tmp_path / 'bus'}"},
        sensor_id="muse_1",
        human_id="p1",
        board="MUSE_2",
        mac_address=ADDRESS,
        streams=["eeg"],
    )

    def says(reason: str) -> bool:
        return any(reason in each for message in health[-1:] for each in message.reasons)

    ears.until(lambda: says("Bluetooth adapter cannot be opened"), "no Bluetooth is told")
    bench = begin(down="true")
    ears.until(lambda: says("is it switched on, near"), "a search without a headband has failed", 90)
    bench.post("/devices/muse_1/knobs", down=False)
    ears.until(lambda: health[-1].state == StreamHealth.STREAMING, "streaming", 120)
    assert health[-1].reconnects_total == 0
    assert driver.stop() == 0


SHIMMER = StreamName("p1", "accelerometer", "shimmer_1")
ON_A_PTY = """
participants: {p1: {}}
devices:
  - {sensor: shimmer_1, model: Shimmer3, participant: p1, at: "pty:PORT"}
"""


def test_a_shimmer_streams_at_the_rate_that_is_asked_for(start, ears, tmp_path):
    """BrainFlow's table says 512 Hz, the Shimmer was left at 51.2: by `commands` it does, and is said to do, 128 Hz."""
    port = tmp_path / "shimmer"
    bench = BenchProcess(tmp_path, devices=ON_A_PTY.replace("PORT", str(port)), ros4hri=False).until_ready()
    try:
        health = ears.hear(StreamHealth, SHIMMER.topic("health"), qos.HEALTH)
        driver = start(
            "driver_brainflow",
            sensor_id="shimmer_1",
            human_id="p1",
            board="SHIMMER3",
            serial_port=str(port),
            commands=["sampling_rate:128"],
            streams=["accelerometer"],
        )
        driver.until("streaming", 60)
        asked = GetParameters.Request(names=["accelerometer.sampling_frequency_hz"])
        (declared,) = ears.ask(GetParameters, "/driver_brainflow_shimmer_1/get_parameters", asked).values
        assert declared.double_value == 128.0
        ears.until(lambda: health and abs(health[-1].measured_rate_hz - 128.0) < 4.0, "128 Hz in health", 60)
        assert health[-1].nominal_rate_hz == 128.0
        assert driver.stop() == 0
    finally:
        bench.end()
