"""Straps, watches and pulse oximeters that speak the standard services and nothing else."""
