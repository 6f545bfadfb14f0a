"""Heart rate straps and watches, and pulse oximeters, over Bluetooth Low Energy."""
