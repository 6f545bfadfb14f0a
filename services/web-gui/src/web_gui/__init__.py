"""The study live in a browser."""
