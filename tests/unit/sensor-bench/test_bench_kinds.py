"""The bench holds devices of any kind: keys, knobs and truth are each kind's own."""

import re
from dataclasses import dataclass, fields

import pytest
from sensor_bench import config
from sensor_bench.ble.peripheral import BleKeys
from sensor_bench.config import parse
from sensor_bench.device import DeviceKeys, Kind
from sensor_bench.kinds import BY_MODEL, KINDS
from sensor_bench.wired import WireKeys


@dataclass(frozen=True, kw_only=True)
class BoxKeys(DeviceKeys):
    """Of a box on a wire, which no kind of the bench is."""

    port: str
    rates_hz: tuple[float, ...] = ()

    unique = ("sensor", "port")

    def check(self) -> None:
        super().check()
        if not self.port.startswith("/"):
            raise ValueError(f"port: {self.port!r} is no path")


@pytest.fixture
def with_box(monkeypatch):
    """A bench that knows boxes too."""
    monkeypatch.setitem(config.BY_MODEL, "Box", Kind(("Box",), BoxKeys, lambda room, keys: None))


def cast(*devices):
    return parse(
        "participants: {p1: {}}\ndevices:\n" + "".join(f"  - {{participant: p1, {each}}}\n" for each in devices)
    )


BOX = "sensor: box, model: Box, port: /tmp/x"
STRAP = 'sensor: h10, model: H10, address: "F1:00:00:00:00:01", device_id: 1A2B3C01'


def test_kinds_stand_side_by_side(with_box):
    """Each entry is the dataclass of its own kind; lists are read."""
    box, strap = cast(BOX + ", rates_hz: [1, 2.5]", STRAP).devices
    assert box == BoxKeys(sensor="box", model="Box", participant="p1", port="/tmp/x", rates_hz=(1.0, 2.5))
    assert isinstance(strap, BY_MODEL["H10"].keys)


@pytest.mark.parametrize(
    ("devices", "reason"),
    [
        ([BOX + ", skew_ppm: 1"], r"devices\[0\]: unknown key 'skew_ppm'"),
        ([STRAP + ", port: /x"], r"devices\[0\]: unknown key 'port'"),
        ([STRAP, BOX.replace("/tmp/x", "x")], r"devices\[1\].port: 'x' is no path"),
        ([BOX + ", rates_hz: [1, fast]"], r"devices\[0\].rates_hz\[1\]: expected float"),
        ([BOX, BOX.replace("box,", "box_2,")], "port '/tmp/x' is used twice"),
        ([BOX.replace("box,", "h10,"), STRAP], "sensor 'h10' is used twice"),
        ([BOX.replace("Box", "Bax")], r"devices\[0\].model: 'Bax' is not one of H10, VeritySense, OH1, .*Box"),
        (["sensor: box, port: /tmp/x"], r"devices\[0\]: model is missing"),
    ],
)
def test_each_kind_is_strict_about_its_own_keys(with_box, devices, reason):
    """A key of another kind, a value that cannot be, one that two devices share: named with its place."""
    with pytest.raises(ValueError, match=reason):
        cast(*devices)


def test_no_model_is_of_two_kinds():
    """`model` decides which kind a device is."""
    models = [model for kind in KINDS for model in kind.models]
    assert len(models) == len(set(models))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.models[0])
def test_every_key_of_a_kind_is_in_its_notes(kind):
    """Whoever writes a study reads of each key that is not every device's, of Bluetooth LE or of a wire."""
    common = {each.name for keys in (DeviceKeys, BleKeys, WireKeys) for each in fields(keys)}
    own = {each.name for each in fields(kind.keys)} - common
    assert {name for name in own if not re.search(rf"\b{name}\b", kind.notes)} == set()
    assert " ".join(kind.notes.split()) in " ".join(config.devices_notes().split())
