"""`known_peers` of driver-lsl: an outlet where no multicast reaches is heard by those that name its machine alone."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from processes import Process, poll
from sense4hri.cdr import read_raw
from sense4hri_recording.reader import Reader
from slow_network import SlowNetwork, why_not

OUTLET = Path(__file__).with_name("numbered_outlet.py")
RATE_HZ, ENOUGH_BYTES = 200.0, 30_000
NAMED, UNNAMED = "lsl_named", "lsl_unnamed"
WHY_NOT = why_not()

pytestmark = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)


@contextmanager
def two_machines(folder: Path) -> Iterator[Process]:
    """An outlet on `lab`; on `here` a recorder and two drivers. Yields the one that does not name `lab`."""
    network, running = SlowNetwork("lab", "here"), list[Process]()

    def start(host: str, *command: str, **parameters: object) -> Process:
        log, before = folder / f"{len(running)}.log", network.inside(host)
        running.append(Process(log, *command, parameters=parameters, before=before))
        return running[-1]

    def driver(name: str, **more: object) -> Process:
        return start("here", "driver_lsl", sensor_id=name, human_id="p1", outlets=["type='ECG'"], **more)

    try:
        start("lab", str(OUTLET), "ECG", str(RATE_HZ))
        start("here", "recorder", directory=str(folder / "recordings"), reports=False)
        driver(NAMED, known_peers=[network.address["lab"]])
        yield driver(UNNAMED)
    finally:
        for process in reversed(running):
            process.end()
        network.close()


def test_an_outlet_beyond_multicast_is_heard_whole_where_its_machine_is_named_and_else_not(
    tmp_path: Path, ros_domain: int
) -> None:
    """While one driver has every sample in order, the other says that it heard nothing at all."""
    with two_machines(tmp_path) as unnamed:
        unnamed.until("no stream fits type='ECG'; heard: none at all")
        files = tmp_path / "recordings"
        poll(lambda: sum(path.stat().st_size for path in files.rglob("*.mcap")) > ENOUGH_BYTES, "a recording grows")
    (folder,) = {path.parent for path in files.rglob("*.mcap")}
    reader = Reader(folder)
    heard = {name: f"/humans/physiological/p1/ecg/{name}/raw" for name in (NAMED, UNNAMED)}
    numbers = np.concatenate([read_raw(record.data).samples[:, 0] for record in reader.messages([heard[NAMED]])])
    assert len(numbers) > 3 * RATE_HZ
    assert np.array_equal(np.diff(numbers), np.ones(len(numbers) - 1)), "samples are lost or out of order"
    assert heard[UNNAMED] not in reader.topics
