"""rcl's own guard condition of the graph, which rclpy does not offer: a wait set that has it wakes up on a change."""

import ctypes
from typing import Any

_RCL = ctypes.PyDLL("librcl.so")  # keeps the interpreter's lock, as rclpy does
_OF_NODE = _RCL.rcl_node_get_graph_guard_condition
_OF_NODE.argtypes, _OF_NODE.restype = [ctypes.c_void_p], ctypes.c_void_p
_ADD = _RCL.rcl_wait_set_add_guard_condition
_ADD.argtypes, _ADD.restype = [ctypes.c_void_p] * 3, ctypes.c_int


class GraphGuard:
    """Of one node, whose handle the caller holds for as long as this is used."""

    def __init__(self, handle: Any) -> None:
        self.pointer = _OF_NODE(handle.pointer)
        """By which a wait set tells that something has changed since the wait before."""
        if not self.pointer:
            raise RuntimeError("rcl names no guard condition of the graph")

    def add_to(self, wait_set: Any) -> None:
        """Have a wait set, after clear_entities, wake up where something has changed. Raises RuntimeError."""
        status = _ADD(wait_set.pointer, self.pointer, None)
        if status:
            raise RuntimeError(f"the graph cannot be waited for: rcl says {status}")
