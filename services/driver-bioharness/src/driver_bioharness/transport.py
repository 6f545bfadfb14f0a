"""How a BioHarness is reached: Bluetooth Classic, or whatever else is a serial link; the only place that opens one."""

from sense4hri.serial_port import Linked, Port, linked

__all__ = ["Linked", "Port", "linked"]
