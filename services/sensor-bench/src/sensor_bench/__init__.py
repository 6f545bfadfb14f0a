"""Virtual sensors on links of their own (Bluetooth LE, serial, LSL, network), and a virtual ROS4HRI side."""
