"""Band powers, indices and quality per channel from raw EEG."""
