"""Any LSL stream as a sensor: signals, gaze, markers."""
