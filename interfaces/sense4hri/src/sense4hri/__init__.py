"""The kit: names, stamps, sample times, parameters, health, and how to run a service.

The pure half (`errors schema names chunk sample_clock grid clock_model stamps hrv`) imports no ROS and works in a
notebook.
"""
