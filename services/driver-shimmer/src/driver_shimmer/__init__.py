"""Shimmer3 over Bluetooth Classic: GSR+, ECG, EMG, IMU."""
