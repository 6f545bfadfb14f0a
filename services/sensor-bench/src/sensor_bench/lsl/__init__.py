"""LSL outlets: real liblsl ones, each sender a process with a clock of its own."""
