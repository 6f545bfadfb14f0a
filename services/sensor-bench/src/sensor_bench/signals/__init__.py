"""What the virtual sensors measure: hearts, and signals simulated or taken from real recordings."""
