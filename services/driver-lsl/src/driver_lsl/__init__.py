"""Driver lsl."""
