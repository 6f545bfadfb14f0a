"""Recordings in files of other programs, as drivers and the bench read them: columns, WFDB, Polar Sensor Logger."""
