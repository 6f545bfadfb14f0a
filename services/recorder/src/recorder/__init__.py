"""Records the study into rosbag2 MCAP and survives being killed."""
