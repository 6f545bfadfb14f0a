"""Tonic level, skin conductance responses and quality from raw EDA."""
