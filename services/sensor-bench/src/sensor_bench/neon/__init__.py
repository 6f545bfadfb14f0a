"""A virtual Neon or Invisible: the Companion app's real-time API, played from simulated gaze."""
