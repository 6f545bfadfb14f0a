"""Virtual Muse headbands."""
