"""Listens to a running driver and says where it departs from the contract."""
