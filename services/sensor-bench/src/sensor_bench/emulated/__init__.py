"""Devices whose emulator lies beside their driver: a file of Python that the bench plays."""
