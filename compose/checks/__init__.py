"""What may be wrong with a study before it starts: one module per kind, each yields findings."""
