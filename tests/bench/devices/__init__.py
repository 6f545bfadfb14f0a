"""Parts of bench_devices: each driver's codec fed by its emulator, and each driver alive in its own study."""
