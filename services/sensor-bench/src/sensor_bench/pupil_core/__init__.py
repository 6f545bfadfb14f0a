"""A virtual Pupil Core: Pupil Capture's network API with two eye cameras, played from simulated gaze."""
