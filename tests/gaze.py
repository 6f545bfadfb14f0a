"""Gaze and pupils with known truth, recordings of trackers, and how they are played through a step without a graph."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sense4hri.chunk import Chunk
from sense4hri.names import StreamName
from sense4hri.sample_clock import SampleClock
from sense4hri.stream_info import StreamInfo
from slow_signals import T0_NS, play

Floats = NDArray[np.float64]
EYELINK_HZ, EYELINK_PX_PER_DEG = 500.0, 43.6  # the latter from amplitudes in px and in deg of its saccades


class EyeLink(NamedTuple):
    """One eye of a recording. gaze: shape (n, 2), px, NaN where lost; pupil: (n,), a.u., 0 where lost.

    Events of the tracker itself, in s since the first sample: (begin, end, ...). blinks; saccades and fixations without
    and with those round a blink.
    """

    gaze: Floats
    pupil: Floats
    blinks: Floats
    saccades: Floats
    fixations: Floats
    lid: NDArray[np.bool_]  # which of the saccades are a blink's


def eyelink(folder: Path, eye: str) -> EyeLink:
    """One eye, `L` or `R`, of the EyeLink recording in a folder of shared data."""
    path = folder / "eye" / "eyelink" / "002_rlmw_{}_short.asc"
    text = Path(str(path).format("samples")).read_text(encoding="utf-8")
    rows = [[float("nan" if word == "." else word) for word in line.split()[:7]] for line in text.splitlines()]
    table = np.array(rows)
    begun_ms, first = table[0, 0], 1 if eye == "L" else 4
    found: dict[str, list[tuple[float, float]]] = {"EFIX": [], "ESACC": [], "EBLINK": []}
    for line in Path(str(path).format("events")).read_text(encoding="utf-8").splitlines():
        words = line.split()
        if len(words) > 4 and words[0] in found and words[1] == eye:
            found[words[0]].append(((float(words[2]) - begun_ms) / 1000, (float(words[3]) - begun_ms) / 1000))
    blinks, saccades, fixations = (np.array(found[name]) for name in ("EBLINK", "ESACC", "EFIX"))
    lid = np.array([((blinks[:, 0] >= begin) & (blinks[:, 1] <= end)).any() for begin, end in saccades])
    return EyeLink(table[:, first : first + 2], table[:, first + 2], blinks, saccades, fixations, lid)


def matched(truth_s: Iterable[float], found_s: Iterable[float], within_s: float) -> tuple[float, Floats]:
    """(F1, errors in s) of events found one to one within so many s of the true ones."""
    truth, found = list(truth_s), list(found_s)
    left, errors = set(range(len(found))), []
    for at_s in truth:
        near = [(abs(found[k] - at_s), k) for k in left if abs(found[k] - at_s) <= within_s]
        if near:
            left.discard(min(near)[1])
            errors.append(min(near)[0])
    return 2 * len(errors) / max(1, len(truth) + len(found)), np.array(errors)


def looking(
    fs_hz: float,
    places: Iterable[tuple[float, float]],
    rest_s: float = 0.3,
    noise: float = 0.02,
    seed: int = 0,
    deg: float = 1.0,
) -> tuple[Floats, Floats]:
    """(gaze, onsets of saccades in s): from place to place, in deg times `deg`, lasting as the main sequence has it."""
    places = list(places)
    times, gaze, onsets, t_s = [], [], [], 0.0
    for here, there in zip(places, [*places[1:], places[-1]], strict=True):
        apart = float(np.hypot(there[0] - here[0], there[1] - here[1]))
        jump_s = 0.0022 * apart + 0.021 if apart else 0.0
        times += [t_s, t_s + rest_s]
        gaze += [here, here]
        t_s += rest_s
        onsets += [t_s] if apart else []
        for part in np.linspace(0, 1, 12)[1:-1] if apart else []:
            times.append(t_s + part * jump_s)
            smooth = part**3 * (10 - 15 * part + 6 * part**2)
            gaze.append((here[0] + smooth * (there[0] - here[0]), here[1] + smooth * (there[1] - here[1])))
        t_s += jump_s
    at_s = np.arange(round(t_s * fs_hz)) / fs_hz
    table = np.array(gaze)
    out = np.column_stack([np.interp(at_s, times, table[:, k]) for k in (0, 1)])
    return (out + np.random.default_rng(seed).normal(0, noise, out.shape)) * deg, np.array(onsets)


def in_deg(samples: Floats, fs_hz: float, make: Any, **options: Any) -> list[Any]:
    """Updates of gaze in deg, shape (n, 2), or with `confidence` as third column."""
    names = ("gaze_x", "gaze_y", "confidence")[: samples.shape[1]]
    return play(make, samples, fs_hz, "eye_tracking", options.pop("unit", "deg"), names, **options)


def at_stamps(
    samples: Floats,
    stamps_s: Floats,
    make: Any,
    sensor_type: str = "eye_tracking",
    unit: str = "deg",
    names: tuple[str, ...] = ("gaze_x", "gaze_y"),
) -> list[Any]:
    """Updates of a stream without a fixed rate: each sample is a message with the device's stamp."""
    clock = SampleClock(0.0)
    step = make(StreamInfo(StreamName("p1", sensor_type, "s1"), 0.0, unit, names))
    updates = []
    for sample, at_s in zip(samples, stamps_s, strict=True):
        stamp_ns = T0_NS + round(float(at_s) * 1e9)
        updates += step.push(clock.place(Chunk(names, sample[None], stamp_ns, stamp_ns)))
    return updates


def pupils(
    fs_hz: float, seconds: float, plateaus: Iterable[tuple[float, float, float]], blinks_s: Iterable[float]
) -> Floats:
    """Sizes of both eyes in mm, shape (n, 2), 3.05 and 2.95 with noise of 0.02.

    plateaus: (begin, end, change), each reached and left within a second; blinks_s: zeros for 0.2 s from there on.
    """
    at_s = np.arange(round(seconds * fs_hz)) / fs_hz
    size = np.full(len(at_s), 3.0)
    for begin_s, end_s, change in plateaus:
        size += change * (np.clip(at_s - begin_s, 0, 1) - np.clip(at_s - end_s, 0, 1))
    noise = np.random.default_rng(4).normal(0, 0.02, (len(at_s), 2))
    out: Floats = size[:, None] + np.array([0.05, -0.05]) + noise
    for blink_s in blinks_s:
        out[(at_s >= blink_s) & (at_s < blink_s + 0.2)] = 0.0
    return out


def extra_of(update: Any, name: str) -> tuple[float, ...]:
    """The values of an entry of `extra`."""
    return next(tuple(feature.values) for feature in update.extra if feature.name == name)
