"""BITalino (r)evolution boards over Bluetooth Classic or any serial link."""
