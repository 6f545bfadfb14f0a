"""Pulses of interpreter-ppg against ECG, a second site and a sensor's own intervals; cost per participant.

    .venv/bin/python tests/bench/bench_ppg.py

Plays the real recordings of ../shared/data through the kit's SampleClock and the service's step, as the service does.
R peaks of the reference ECG are those of `neurokit2`.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
from interpreter_ppg.config import Config
from interpreter_ppg.stream import PpgStream, PpgUpdate
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo

Floats = NDArray[np.float64]
Row = dict[str, Any]

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
MATCH_S = 0.15
CONFIRMED_S = 2.0  # the contract's time to confirm a pulse: a recording's last beats have no update after them


def play(
    samples: Floats,
    device_ns: NDArray[np.int64],
    nominal_hz: float,
    frame: int = 10,
    config: Config | None = None,
    names: tuple[str, ...] = (),
) -> list[PpgUpdate]:
    """Return every update of one recording. samples: shape (n, channels); device_ns: shape (n,)."""
    names = names or tuple(f"ppg_{i}" for i in range(samples.shape[1]))
    info = StreamInfo(StreamName("p1", "ppg", "s1"), nominal_hz, "counts", names)
    clock, step = SampleClock(nominal_hz), PpgStream(config or Config(), info)
    updates = []
    for start in range(0, len(samples) - frame + 1, frame):
        stop = start + frame
        stamp_ns = int(device_ns[stop - 1])
        updates += step.push(clock.place(Chunk(names, samples[start:stop], stamp_ns, stamp_ns)))
    return updates


def pulses_s(updates: list[PpgUpdate], first_ns: int = 0) -> Floats:
    """Return the times of all published pulses in s after first_ns."""
    return np.array([(t - first_ns) / 1e9 for update in updates for t in update.peak_timestamps])


def evenly(n: int, fs_hz: float) -> NDArray[np.int64]:
    """Return device stamps of n samples at fs_hz, beginning at 1000 s."""
    return 1_000_000_000_000 + np.rint(np.arange(n) * (1e9 / fs_hz)).astype(np.int64)


def matched(
    reference_s: Floats, found_s: Floats, longest_lag_s: float = 1.0
) -> tuple[NDArray[np.bool_], float, Floats]:
    """Match one to one within MATCH_S after the best constant lag.

    Returns which reference events were found, the lag in s and the remaining differences of the matched in s.
    """

    def nearest(lag_s: float) -> tuple[NDArray[np.intp], Floats]:
        at = np.clip(np.searchsorted(found_s, reference_s + lag_s), 1, len(found_s) - 1)
        at = np.where(found_s[at] + found_s[at - 1] > 2 * (reference_s + lag_s), at - 1, at)
        return at, found_s[at] - reference_s - lag_s

    lags = np.arange(-longest_lag_s, longest_lag_s, 0.02)
    lag_s = float(lags[np.argmax([np.count_nonzero(np.abs(nearest(lag)[1]) < 0.1) for lag in lags])])
    for _ in range(3):
        at, difference = nearest(lag_s)
        lag_s += float(np.median(difference[np.abs(difference) < MATCH_S]))
    at, difference = nearest(lag_s)
    hit = np.abs(difference) < MATCH_S
    _, first = np.unique(at[hit], return_index=True)
    once = np.zeros(len(hit), bool)
    once[np.flatnonzero(hit)[first]] = True
    return once, lag_s, difference[once]


def verity() -> tuple[NDArray[np.int64], Floats, Floats, NDArray[np.bool_]]:
    """Return device stamps (n,), samples (n, 4), the device's own intervals in ms (m,) and which are valid (m,)."""
    folder = DATA / "polar" / "verity_sense"
    lines = [line.split(";") for line in (folder / "Polar_Sense_PPG.txt").read_text().splitlines()[1:]]
    stamps_ns = np.array([int(line[1]) for line in lines])
    samples = np.array([[float(value) for value in line[2:6]] for line in lines])
    intervals = np.array(
        [line.split(";")[1:4] for line in (folder / "Polar_Sense_PPI.txt").read_text().splitlines()[1:]]
    )
    ppi_ms, error_ms, blocked = intervals.astype(float).T
    return stamps_ns, samples, ppi_ms, (blocked == 0) & (error_ms < 30)


def physiokit(participant: str) -> tuple[NDArray[np.int64], Floats]:
    """Return device stamps (n,) and PPG of finger and ear (n, 2)."""
    (file,) = (DATA / "multimodal" / "physiokit").glob(f"{participant}_baseline_*.csv")
    table = np.genfromtxt(file, delimiter=",", skip_header=1, usecols=(2, 3, 4))
    return np.rint(table[:, 2] * 1e6).astype(np.int64), table[:, :2]


def ecg_row() -> Row:
    """Pulses at rest against the simultaneous ECG."""
    import neurokit2 as nk

    file = DATA / "multimodal" / "neurokit" / "bio_resting_5min_100hz.csv"
    ecg, ppg, _ = np.loadtxt(file, delimiter=",", skiprows=1).T
    stamps_ns = evenly(len(ppg), 100.0)
    r_peaks_s = nk.ecg_peaks(nk.ecg_clean(ecg, 100), 100)[1]["ECG_R_Peaks"] / 100
    pulses = pulses_s(play(ppg[:, None], stamps_ns, 100.0), int(stamps_ns[0]))
    hit, lag_s, rest_s = matched(r_peaks_s[r_peaks_s < len(ppg) / 100 - CONFIRMED_S], pulses)
    measured = (
        f"{hit.sum()}/{len(hit)} = {100 * hit.mean():.2f} %, PAT {1000 * lag_s:.0f} +-{1000 * rest_s.std():.1f} ms"
    )
    return row(
        "beats of the ECG found, bio_resting_5min (two artefacts among them)",
        ">= 99 %",
        measured,
        100 * hit.mean() >= 99,
    )


def sites_row(participant: str, first: int, second: int) -> Row:
    """Pulses at one site found at the other, both alone."""
    stamps_ns, samples = physiokit(participant)
    sites = [pulses_s(play(samples[:, [i]], stamps_ns, 250.0), int(stamps_ns[0])) for i in (first, second)]
    hit, lag_s, rest_s = matched(*sites)
    measured = f"{hit.sum()}/{len(hit)} = {100 * hit.mean():.2f} %, {1000 * lag_s:.0f} +-{1000 * rest_s.std():.1f} ms"
    name = "finger found at the ear" if first == 0 else "ear found at the finger"
    return row(f"pulses of the {name}, PhysioKit {participant}", ">= 99 %", measured, 100 * hit.mean() >= 99)


def verity_rows() -> list[Row]:
    """Pulses of a Verity Sense against its own intervals, and the mean rate over its valid stretches."""
    stamps_ns, samples, ppi_ms, valid = verity()
    updates = play(samples, stamps_ns, 55.0, 36, names=("ppg_0", "ppg_1", "ppg_2", "ambient"))
    pulses = pulses_s(updates, int(stamps_ns[0]))
    ends_s = np.cumsum(ppi_ms) / 1000
    hit, lag_s, rest_s = matched(ends_s, pulses, longest_lag_s=25.0)
    share = 100 * hit[valid].mean()
    measured = f"{hit[valid].sum()}/{valid.sum()} = {share:.2f} %, +-{1000 * rest_s.std():.1f} ms"
    found = row("valid intervals of the Verity Sense found, one lag", ">= 98 %", measured, share >= 98)
    worst = 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], valid, [0]])))
    for start, stop in edges.reshape(-1, 2):
        if stop - start < 10:
            continue
        begin_s, end_s = ends_s[start] - ppi_ms[start] / 1000 + lag_s, ends_s[stop - 1] + lag_s
        own = pulses[(pulses > begin_s - 0.1) & (pulses < end_s + 0.1)]
        worst = max(worst, abs(60 * (len(own) - 1) / (own[-1] - own[0]) - 60_000 / ppi_ms[start:stop].mean()))
    rate = row("mean rate, stretches of 10 and more valid intervals", "<= 0.3 /min", f"{worst:.3f} /min", worst <= 0.3)
    return [found, rate]


def cost_row() -> Row:
    """CPU of the computation alone for one participant with three optical channels at 55 Hz."""
    stamps_ns, samples, _, _ = verity()
    started = time.process_time()
    updates = play(samples, stamps_ns, 55.0, 36, names=("ppg_0", "ppg_1", "ppg_2", "ambient"))
    percent = 100 * (time.process_time() - started) / ((stamps_ns[-1] - stamps_ns[0]) / 1e9)
    measured = f"{percent:.3f} % of a core, {len(updates)} updates"
    return row("computation per participant, 3 channels at 55 Hz", "<= 0.5 %", measured, percent <= 0.5)


def row(what: str, target: str, measured: str, ok: bool) -> Row:
    return {"what": what, "target": target, "measured": measured, "ok": bool(ok)}


def rows() -> list[Row]:
    """Every number of this page."""
    return [ecg_row(), sites_row("P11", 0, 1), sites_row("P11", 1, 0), *verity_rows(), cost_row()]


if __name__ == "__main__":
    print("| what | target | measured | ok |\n|---|---|---|---|")
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {'yes' if entry['ok'] else 'NO'} |")
