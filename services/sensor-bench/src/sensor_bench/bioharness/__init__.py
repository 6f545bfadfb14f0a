"""A virtual Zephyr BioHarness 3."""
