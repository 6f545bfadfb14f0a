"""Muse headbands as a kind of the bench."""

from sensor_bench.device import Kind
from sensor_bench.muse.peripheral import Headband, MuseKeys

MUSE = Kind(
    ("Muse2",),
    MuseKeys,
    Headband,
    'name "Muse-1A2B" (as it advertises itself), counter_start 0 (number of each stream\'s first packet)',
)
