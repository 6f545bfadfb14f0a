"""Any heart rate strap, watch or pulse oximeter over Bluetooth Low Energy."""
