"""Driver brainflow."""
