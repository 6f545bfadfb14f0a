"""Plays a recording back onto the graph: original stamps, order and quality of service, at any speed."""
