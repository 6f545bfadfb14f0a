"""Interpreter pupillometry."""
