"""What every driver keeps of its device: ten emulated minutes with loss, a restart and a wrap; cost; coming back.

    .venv/bin/python tests/bench/run.py devices            # ten seconds for each codec, a minute for each study

A new driver: a function in devices/packets.py, serial_links.py, reports.py or recordings.py that returns `Played`,
entered in `PLAYED` (driver-lsl's is in bench_lsl.py, beside the real liblsl). It feeds the emulator's bytes, one per
cent of them lost, to the driver's codec at once, and every `Samples` that comes out to a `Tally`, which counts as the
kit does. The second part (devices/live.py) needs no entry: each driver's own study (compose/studies/<name>.yaml) is
started, its CPU measured, its device switched off and on again over the bench.
"""

from collections.abc import Callable
from typing import Any

from devices.live import live_rows, studies
from devices.packets import brainflow_cyton, polar_h10, pupil_core, pupil_neon, vernier_belt
from devices.played import Played, codec_rows
from devices.recordings import columns_of_text
from devices.reports import heart_rate_strap, pulse_oximeter
from devices.serial_links import bioharness_ecg, bitalino, microcontroller, shimmer_gsr

PLAYED: tuple[Callable[[], Played], ...] = (
    polar_h10,
    brainflow_cyton,
    bitalino,
    microcontroller,
    vernier_belt,
    shimmer_gsr,
    bioharness_ecg,
    pupil_core,
    pupil_neon,
    heart_rate_strap,
    pulse_oximeter,
    columns_of_text,
)


def rows() -> list[dict[str, Any]]:
    """Rows of every driver: what it keeps, what it costs, how soon it is back."""
    return [row for play in PLAYED for row in codec_rows(play())] + [
        row for name in studies() for row in live_rows(name)
    ]


if __name__ == "__main__":
    for row in rows():
        print(row["what"], "|", row["target"], "|", row["measured"], "|", row["ok"])
