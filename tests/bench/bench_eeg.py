"""EEG: what is found in real recordings beside MNE and SciPy in the same run, quality on a ladder, and the cost.

    .venv/bin/python tests/bench/run.py eeg

Recordings are those of ../shared/data; rows of absent ones are left out. About two minutes on an idle core.
"""

import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from interpreter_eeg.config import Config
from interpreter_eeg.stream import EegStream
from numpy.typing import NDArray
from sense4hri.chunk import TimedChunk
from sense4hri.names import StreamName
from sense4hri.stream_info import StreamInfo

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from brain_signals import BIOSPPY_HZ, BLINKS_S, EEGLAB, EEGLAB_HZ, blink_times_s, brain, eeglab, extra, play
from costs import cost_percent, memory_mib

Floats = NDArray[np.float64]
Row = dict[str, Any]

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"
ALPHA_HZ, ALL_HZ = (8.0, 13.0), (1.0, 45.0)
HOURS = 3.0


def row(what: str, target: str, measured: str, ok: bool | None) -> Row:
    """One line of docs/benchmarks.md."""
    return {"what": what, "target": target, "measured": measured, "ok": None if ok is None else bool(ok)}


def mne_spectrum(samples: Floats, fs_hz: float) -> tuple[Floats, Floats]:
    """Frequencies and power density, shape (bins, channels), of MNE's Welch with our segments."""
    import mne

    count = round(2 * fs_hz)
    psd, hz = mne.time_frequency.psd_array_welch(
        samples.T, fs_hz, n_fft=count, n_overlap=count // 2, window="hann", verbose="ERROR"
    )
    return hz, psd.T


def mne_alpha_share(samples: Floats, fs_hz: float) -> Floats:
    """The share of alpha, as MNE has it on the whole recording."""
    hz, psd = mne_spectrum(samples, fs_hz)
    alpha, whole = (psd[(hz >= low) & (hz < high)].sum(axis=0) for low, high in (ALPHA_HZ, ALL_HZ))
    return np.asarray(alpha / whole)


def shares(updates: list[Any]) -> Floats:
    """The median share of alpha over the updates, per channel."""
    return np.asarray(np.nanmedian([extra(update, "relative_alpha") for update in updates if update.extra], axis=0))


def eyes() -> Row:
    """Closed against open eyes."""
    recordings = [np.loadtxt(SHARED / "eeg" / "biosppy" / f"eeg_{eyes}.txt")[:, None] for eyes in ("ec", "eo")]
    ours = [float(shares(play(samples, BIOSPPY_HZ, ["EEG"], "counts"))[0]) for samples in recordings]
    theirs = [float(mne_alpha_share(samples, BIOSPPY_HZ)[0]) for samples in recordings]
    texts = [f"{closed:.3f} / {opened:.3f} = {closed / opened:.1f}" for closed, opened in (ours, theirs)]
    what = "share of alpha, eyes closed over open (eeg/biosppy)"
    return row(what, ">= 2", f"{texts[0]}; MNE {texts[1]}", ours[0] >= 2 * ours[1])


def cap() -> list[Row]:
    """The 32 channels of EEGLAB."""
    samples = eeglab(SHARED)
    updates = play(samples, EEGLAB_HZ, EEGLAB)
    hz, psd = mne_spectrum(samples, EEGLAB_HZ)
    alike = [
        np.array(update.alpha_uv2) / _mne_alpha(samples[first : first + round(20 * EEGLAB_HZ)])
        for update, first in ((updates[at], round((at - 19) * EEGLAB_HZ)) for at in range(19, len(updates), 10))
    ]
    peak_hz = float(np.nanmedian([extra(update, "alpha_peak")[0] for update in updates if update.extra]))
    back = psd[:, EEGLAB.index("POz")] * ((hz >= 7) & (hz <= 13))
    ours, theirs = (
        dict(zip(EEGLAB, found, strict=True)) for found in (shares(updates), mne_alpha_share(samples, EEGLAB_HZ))
    )
    named = [", ".join(f"{name} {found[name]:.2f}" for name in ("Oz", "POz", "Fz")) for found in (ours, theirs)]
    ratio = float(np.nanmedian(alike))
    peaks = f"{peak_hz:.2f} Hz; MNE's highest bin {hz[back.argmax()]:.1f} Hz"
    return [
        row("individual alpha peak (EEGLAB)", "10 +- 0.5 Hz", peaks, abs(peak_hz - 10) <= 0.5),
        row("share of alpha (EEGLAB)", "Oz > Fz", f"{named[0]}; MNE {named[1]}", ours["Oz"] > ours["Fz"]),
        row(
            "alpha in uV^2 over that of MNE on the same 20 s, median of 32 channels",
            "0.9 to 1.1",
            f"{ratio:.3f}",
            abs(ratio - 1) <= 0.1,
        ),
        blinks(updates, samples),
    ]


def _mne_alpha(samples: Floats) -> Floats:
    hz, psd = mne_spectrum(samples, EEGLAB_HZ)
    return np.asarray(psd[(hz >= ALPHA_HZ[0]) & (hz < ALPHA_HZ[1])].sum(axis=0) * hz[1])


def blinks(updates: list[Any], samples: Floats) -> Row:
    """Blinks against those that are seen in a picture of the recording."""
    import mne

    raw = mne.io.RawArray(samples.T * 1e-6, mne.create_info(list(EEGLAB), EEGLAB_HZ, "eeg"), verbose="ERROR")
    events = mne.preprocessing.find_eog_events(raw, ch_name="FPz", verbose="ERROR")
    texts = []
    for found_s in (blink_times_s(updates), events[:, 0] / EEGLAB_HZ):
        hits = int(sum(np.abs(np.asarray(found_s) - at_s).min() < 0.2 for at_s in BLINKS_S))
        texts.append(f"{hits} and {len(found_s) - hits} others")
    what = f"the {len(BLINKS_S)} blinks of a hand list (EEGLAB)"
    return row(what, "", f"{texts[0]}; MNE {texts[1]}", None)


def ladders() -> list[Row]:
    """Mean quality of the 32 channels as something is added; white noise alone."""
    samples = eeglab(SHARED)[: round(60 * EEGLAB_HZ)] if SHARED.is_dir() else brain(60, EEGLAB_HZ, len(EEGLAB))
    times_s = np.arange(len(samples))[:, None] / EEGLAB_HZ
    white = np.random.default_rng(1).normal(size=samples.shape)
    steps: dict[str, Callable[[int], Floats]] = {
        "white noise, 10 uV a step": lambda k: samples + 10 * k * white,
        "mains, 200 uV a step": lambda k: samples + 200 * k * np.sin(2 * np.pi * 50 * times_s),
        "drift, 50 uV/s a step": lambda k: samples + 50 * k * times_s,
        "motion at 1.3 Hz, 100 uV a step": lambda k: samples + 100 * k * np.sin(2 * np.pi * 1.3 * times_s),
        "0.7 s of 10 s lost a step": lambda k: np.where(times_s % 10 < 0.7 * k, np.nan, samples),
    }
    rows = []
    for what, step in steps.items():
        means = [
            float(np.mean([u.signal_quality for u in play(step(k), EEGLAB_HZ, EEGLAB)[20:]])) for k in (0, 1, 2, 4)
        ]
        falls = all(one > other for one, other in pairwise(means))
        rows.append(row(f"signal_quality with {what}", "falls", " ".join(f"{mean:.2f}" for mean in means), falls))
    noise = play(10 * np.random.default_rng(2).normal(size=(300 * 256, 4)), 256.0, ("Fp1", "Fp2", "O1", "O2"))
    told = float(np.mean([np.isfinite(update.alpha_uv2).mean() for update in noise[2:]]))
    return [
        *rows,
        row("updates of white noise of 10 uV that have a band power", "0 %", f"{100 * told:.2f} %", told == 0),
    ]


def costs() -> list[Row]:
    """CPU beside whole-window calls, each once per second."""
    import scipy.signal

    samples = brain(60, 500.0, 32)
    hummed = samples + 100 * np.sin(2 * np.pi * 50 * np.arange(len(samples)) / 500.0)[:, None]
    window = samples[:10_000]
    play(samples[:2000], 500.0, EEGLAB)
    ours, with_hum = (cost_percent(lambda x=x: play(x, 500.0, EEGLAB), 60.0) for x in (samples, hummed))
    mne_spectrum(window, 500.0)
    theirs = cost_percent(lambda: [mne_spectrum(window, 500.0) for _ in range(10)], 10.0)
    welch = cost_percent(lambda: [scipy.signal.welch(window, 500.0, nperseg=1000, axis=0) for _ in range(10)], 10.0)
    theirs_too = f"spectra of 20 s alone, every second: MNE {theirs:.2f} %, SciPy {welch:.2f} %"
    told = f"{ours:.2f} %, with mains {with_hum:.2f} %; {theirs_too}"
    few = cost_percent(lambda: play(samples[:, :4], 500.0, EEGLAB[:4]), 60.0)
    return [
        row("CPU of the step, 32 channels at 500 Hz", "<= 5 % of a core", told, max(ours, with_hum) <= 5),
        row("CPU of the step, 4 channels at 500 Hz", "<= 1 % of a core", f"{few:.2f} %", few <= 1),
    ]


def memory() -> Row:
    """Growth over hours of signal, fast-forwarded; the updates are not kept."""
    fs_hz, names = 250.0, EEGLAB[:8]
    minute = brain(60, fs_hz, len(names))
    step = EegStream(Config(), StreamInfo(StreamName("p1", "eeg", "s1"), fs_hz, "uV", names))
    within_ns = (np.arange(250) * 4_000_000).astype(np.int64)
    held = []
    for second in range(round(HOURS * 3600)):
        times_ns = within_ns + second * 10**9
        part = minute[(second % 60) * 250 : (second % 60 + 1) * 250]
        step.push(TimedChunk(names, part, times_ns, int(times_ns[-1]), int(times_ns[-1]), None, 0))
        if second in (60, round(HOURS * 3600) - 1):
            held.append(memory_mib())
    grown = held[1] - held[0]
    what = f"memory over {HOURS:g} h of 8 channels at 250 Hz, fast-forwarded"
    return row(what, "<= 5 MiB", f"{grown:+.1f} MiB", grown <= 5)


def rows() -> list[Row]:
    """Accuracy on what is there, ladders, and costs."""
    return [*([eyes(), *cap()] if SHARED.is_dir() else []), *ladders(), *costs(), memory()]


if __name__ == "__main__":
    for entry in rows():
        print(f"| {entry['what']} | {entry['target']} | {entry['measured']} | {entry['ok']} |", flush=True)
