"""Muse headbands as a kind of the bench."""

from sensor_bench.device import Kind
from sensor_bench.muse.peripheral import Headband, MuseKeys

MUSE = Kind(("Muse2",), MuseKeys, Headband)
