"""Cleaned size, baseline, change and activity of pupils, from raw pupillometry."""
