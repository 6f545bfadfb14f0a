"""A Bluetooth computer that is not there: `org.bluez` on a private D-Bus, in front of a simulated radio."""
