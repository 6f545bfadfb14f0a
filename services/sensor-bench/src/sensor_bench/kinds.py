"""The kinds of devices the bench can play; a new one is a folder and a line here."""

from sensor_bench.bioharness.kind import BIOHARNESS
from sensor_bench.bitalino.kind import BITALINO
from sensor_bench.board.kind import BOARD
from sensor_bench.device import Kind
from sensor_bench.emulated import ble, lsl
from sensor_bench.heart_rate.oximeter import OXIMETER
from sensor_bench.heart_rate.strap import STRAP, WATCH
from sensor_bench.lsl.kind import LSL
from sensor_bench.muse.kind import MUSE
from sensor_bench.neon.kind import NEON
from sensor_bench.polar.kind import POLAR
from sensor_bench.pupil_core.kind import CORE
from sensor_bench.shimmer.kind import SHIMMER
from sensor_bench.vernier.belt import BELT

KINDS: tuple[Kind, ...] = (
    POLAR,
    BITALINO,
    BOARD,
    SHIMMER,
    STRAP,
    WATCH,
    OXIMETER,
    CORE,
    MUSE,
    LSL,
    BELT,
    BIOHARNESS,
    NEON,
    ble.BLE,
    lsl.LSL,
)
BY_MODEL: dict[str, Kind] = {model: kind for kind in KINDS for model in kind.models}
