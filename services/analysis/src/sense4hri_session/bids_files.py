"""What every file of a BIDS folder is written with."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

from sense4hri_session.stream import Stream

UNITS = {"a.u.": "arbitrary", "counts": "arbitrary", "degC": "oC", "px": "pixel", "1": "arbitrary"}
"""As BIDS spells them; others stay as they are."""


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Write a sidecar."""
    path.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", "utf-8", "backslashreplace")


def write_tsv(path: Path, columns: list[str], rows: list[dict[str, str]]) -> None:
    """Write a table with a line of names."""
    with path.open("x", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, columns, delimiter="\t", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def device_of(stream: Stream) -> dict[str, str]:
    """Return what a sidecar says of the device."""
    names = {
        "Manufacturer": "vendor",
        "ManufacturersModelName": "model",
        "DeviceSerialNumber": "serial_number",
        "SoftwareVersions": "firmware_version",
    }
    return {key: str(stream.metadata.get(name) or "n/a") for key, name in names.items()}
