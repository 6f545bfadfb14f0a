"""Offset, skew and uncertainty of every device clock against ROS time."""
