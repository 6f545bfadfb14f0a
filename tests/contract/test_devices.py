"""docs/devices.md is what the drivers say of their devices, and what they say is what they declare."""

import importlib

import devices
import pytest
from sense4hri import schema
from sense4hri.device import Stream
from sense4hri.devices import DeviceRow, Offered, departures

each_driver = pytest.mark.parametrize("driver", devices.drivers(), ids=lambda path: path.name)
ROW = DeviceRow(
    device="Box",
    vendor="",
    streams={"eda": Offered("uS", 4, 8)},
    clock="ms",
    loss="counter",
    link="tty",
    seen_on="virtual",
)


def test_the_page_is_what_generate_writes():
    """Rows and words come from their sources, no second place."""
    for path, text in devices.files().items():
        assert path.read_text() == text, "make generate"


@each_driver
def test_the_rows_are_what_the_driver_declares(driver):
    """A driver has rows; where its streams are known before connecting, each is in the row with its unit and rate."""
    rows, package = devices.rows_of(driver), driver.name.replace("-", "_")
    assert rows
    streams_of = getattr(importlib.import_module(f"{package}.config"), "streams_of", None)
    config = schema.schema_of(package)
    for row in rows:
        if streams_of is not None:
            assert departures(row, streams_of(config(sensor_id="it_1", **row.chosen_by))) == []


@pytest.mark.parametrize(
    ("declared", "named"),
    [
        ({"eda": Stream(4.0, "counts", 0.0, 1.0, 8, ("eda",))}, "in counts, the row says uS"),
        ({"eda": Stream(16.0, "uS", 0.0, 1.0, 8, ("eda",))}, "16 Hz, the row says 4 to 8 Hz"),
        ({}, "in the row and not declared"),
        (
            {sensor_type: Stream(4.0, "uS", 0.0, 1.0, 8, ("eda",)) for sensor_type in ("eda", "ecg")},
            "ecg is declared and not in the row",
        ),
    ],
)
def test_a_row_that_lies_is_found(declared, named):
    """Another unit, another rate, a stream too many or too few is a sentence."""
    (found,) = departures(ROW, declared)
    assert named in found
