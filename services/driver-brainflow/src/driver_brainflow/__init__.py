"""Every board that BrainFlow knows: EEG, ECG, EMG, motion, PPG, skin conductance."""
