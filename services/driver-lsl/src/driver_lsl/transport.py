"""The outlets on the network, over the kit's LSL inlets."""

from sense4hri.lsl_inlets import Link, Measured, News, Opened, Pulled, Told

from driver_lsl.config import LslConfig

__all__ = ["Measured", "News", "Opened", "Pulled", "Told", "link"]


def link(config: LslConfig) -> Link:
    """Return a connection to the device's outlets, which is made by reading."""
    return Link(config, config.outlets)
