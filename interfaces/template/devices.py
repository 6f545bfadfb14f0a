"""`docs/devices.md`, from the `DEVICES` of each driver and what `devices.md.in` says by hand."""

import importlib
from collections.abc import Iterable
from pathlib import Path

from sense4hri.devices import DeviceRow

ROOT = Path(__file__).resolve().parents[2]
SOURCE = Path("interfaces/template/devices.md.in")
PAGE = Path("docs/devices.md")
TABLE = "@devices@\n"
NOTE = "<!-- Written by make generate: rows from DEVICES in each driver's config.py, words from {} -->\n"
HEAD = ("device", "driver", "samples", "device's own values", "clock", "loss is noticed by", "link", "seen on")


def drivers(root: Path = ROOT) -> list[Path]:
    """Return the folders of all drivers."""
    return sorted(path.parents[1] for path in root.glob("services/driver-*/config/default.yaml"))


def rows_of(driver: Path) -> tuple[DeviceRow, ...]:
    """Return what a driver says of its devices. Raises AttributeError where its config.py has no DEVICES."""
    rows: tuple[DeviceRow, ...] = importlib.import_module(f"{driver.name.replace('-', '_')}.config").DEVICES
    return rows


def page(root: Path = ROOT) -> str:
    """Return the text of docs/devices.md."""
    lines = [_line(HEAD), _line(["---"] * len(HEAD))]
    lines += [_line(_cells(driver, row)) for driver in drivers(root) for row in rows_of(driver)]
    source = (root / SOURCE).read_text()
    if TABLE not in source:
        raise ValueError(f"{SOURCE}: no line {TABLE.strip()}")
    return NOTE.format(SOURCE) + source.replace(TABLE, "".join(lines))


def files(root: Path = ROOT) -> dict[Path, str]:
    """Return the page with the text it must have."""
    return {root / PAGE: page(root)}


def _cells(driver: Path, row: DeviceRow) -> Iterable[str]:
    vendor = f" ({row.vendor})" if row.vendor and row.vendor not in row.device else ""
    samples = [
        f"{name} {offered.rates}{f', {offered.unit}' * bool(offered.unit)}" for name, offered in row.streams.items()
    ]
    reports = ", ".join(f"`{name}`" for name in row.reports)
    link = f"[{driver.name}](../services/{driver.name}/README.md)"
    return row.device + vendor, link, "<br>".join(samples), reports, row.clock, row.loss, row.link, row.seen_on


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |\n"
