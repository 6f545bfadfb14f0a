"""Virtual Polar sensors behind a BlueZ stand-in, and a virtual ROS4HRI side."""
