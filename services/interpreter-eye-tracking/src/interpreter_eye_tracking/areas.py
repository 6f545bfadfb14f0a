"""Areas of interest: rectangles and polygons in the gaze's unit, read from a file, and what lies in them."""

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

MOST = 64
NAME = r"[a-z][a-z0-9_]{0,31}"

Floats = NDArray[np.float64]


class Area(NamedTuple):
    """One area. corners: shape (k, 2), k >= 3, in the gaze's unit; the last is joined to the first."""

    name: str
    corners: Floats

    def holds(self, gaze: Floats) -> NDArray[np.bool_]:
        """Return which points, shape (n, 2), lie inside: a line from there crosses the edge an odd number of times."""
        x, y = gaze[:, :1], gaze[:, 1:]
        x1, y1 = self.corners.T
        x2, y2 = np.roll(self.corners, -1, axis=0).T
        with np.errstate(divide="ignore", invalid="ignore"):
            crossed = ((y1 > y) != (y2 > y)) & (x < x1 + (y - y1) * (x2 - x1) / (y2 - y1))
        return np.asarray(crossed.sum(axis=1) % 2 == 1)


def read_areas(path: str) -> tuple[Area, ...]:
    """Return the areas of a YAML file. ValueError says in one sentence what is wrong in it."""
    try:
        listed = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"cannot read {path}: {error}") from error
    except yaml.YAMLError as error:
        raise ValueError(f"{path} is no YAML: {' '.join(str(error).split())}") from error
    if not isinstance(listed, list) or not 1 <= len(listed) <= MOST:
        raise ValueError(f"{path} must hold a list of 1 to {MOST} areas")
    areas = tuple(_area(entry) for entry in listed)
    if len({area.name for area in areas}) < len(areas):
        raise ValueError(f"{path} names two areas alike")
    return areas


def _area(entry: Any) -> Area:
    if not isinstance(entry, dict) or set(entry) not in ({"name", "rectangle"}, {"name", "polygon"}):
        raise ValueError(f"{entry!r} must have `name` and either `rectangle` or `polygon`")
    name = entry["name"]
    if not isinstance(name, str) or not re.fullmatch(NAME, name):
        raise ValueError(f"name {name!r} must be small letters, digits and '_', a letter first, at most 32")
    try:
        numbers = np.array(entry.get("rectangle", entry.get("polygon")), dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    corners = _rectangle(numbers) if "rectangle" in entry else numbers
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise ValueError(f"area {name}: rectangle is [x1, y1, x2, y2], polygon a list of at least three [x, y]")
    if np.linalg.matrix_rank(corners - corners[0]) < 2:
        raise ValueError(f"area {name}: its corners are on one line, no gaze lies in it")
    return Area(name, corners)


def _rectangle(numbers: Floats) -> Floats:
    if numbers.shape != (4,):
        return np.empty((0, 2))
    x1, y1, x2, y2 = numbers
    return np.array([[x1, y1], [x2, y1], [x2, y2], [x1, y2]])
