"""Any microcontroller on a serial link, its frames described in a YAML file."""
