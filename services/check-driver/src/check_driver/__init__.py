"""Says where a running driver, in any language, departs from the contract."""
