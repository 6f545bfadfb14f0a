"""Polar's delta compression: one reference sample, then blocks of bit-packed differences; no I/O, no clock.

    [reference: one value per channel] [bit width w][count n][ceil(w * n * channels / 8) bytes] [w][n][...] ...

Differences are two's complement, packed least significant bit first across bytes, channels interleaved, each relative
to the sample before it. Every block starts on a byte. The reference is sample 0, so a frame holds 1 + sum(n) samples.
Source: polarofficial/polar-ble-sdk, technical documentation and test vectors; the code is our own.
"""

import numpy as np
from numpy.typing import NDArray
from sense4hri.errors import FrameError

WIDEST_BITS = 32  # a difference of two int32 modulo 2**32 fits


def signed_values(octets: bytes, size: int) -> NDArray[np.int64]:
    """Read whole little-endian two's complement integers of `size` bytes; shape (len(octets) / size,)."""
    digits = np.frombuffer(octets, np.uint8).reshape(-1, size).astype(np.int64)
    return digits @ (1 << 8 * np.arange(size, dtype=np.int64)) - ((digits[:, -1] >> 7) << 8 * size)


def decode_delta(content: bytes, channels: int, size: int) -> NDArray[np.int32]:
    """Return all samples of a compressed frame's content; shape (samples, channels), in the device's counts.

    size: bytes of one value of the reference sample. Sums wrap around at 32 bits, as on the device: float32 values
    travel as the differences of their bit patterns. A width of 0 repeats the sample. Raises FrameError where the
    content ends inside the reference, a block's head or a block, or a width exceeds 32 bits.
    """
    at = channels * size
    if len(content) < at:
        raise FrameError(f"compressed content of {len(content)} bytes is shorter than its {at}-byte reference sample")
    steps = [signed_values(content[:at], size).reshape(1, channels)]
    while at < len(content):
        if len(content) - at < 2:
            raise FrameError(f"delta block {len(steps)} ends inside its two-byte head")
        width, count = content[at], content[at + 1]
        packed = content[at + 2 : at + 2 + -(-width * count * channels // 8)]
        steps.append(_block(packed, width, count * channels, len(steps)).reshape(count, channels))
        at += 2 + len(packed)
    return np.cumsum(np.concatenate(steps), axis=0).astype(np.int32)


def _block(packed: bytes, width: int, values: int, number: int) -> NDArray[np.int64]:
    """Unpack one block's differences; shape (values,)."""
    if width > WIDEST_BITS:
        raise FrameError(f"delta block {number} is {width} bits wide, more than {WIDEST_BITS}")
    if len(packed) * 8 < width * values:
        raise FrameError(f"delta block {number} is cut: {values} values of {width} bits in {len(packed)} bytes")
    if width == 0:
        return np.zeros(values, np.int64)
    bits = np.unpackbits(np.frombuffer(packed, np.uint8), count=width * values, bitorder="little")
    weights = 1 << np.arange(width, dtype=np.int64)
    weights[-1] = -weights[-1]  # the sign bit
    return bits.reshape(values, width).astype(np.int64) @ weights
