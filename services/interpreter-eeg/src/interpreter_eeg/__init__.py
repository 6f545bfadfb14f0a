"""Interpreter of electroencephalograms (EEG)."""
