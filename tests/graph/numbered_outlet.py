"""An LSL outlet whose samples carry their number: numbered_outlet.py TYPE RATE_HZ, until it is ended."""

import sys
import time

import pylsl


def main(content_type: str, rate_hz: float) -> None:
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo("Numbered", content_type, 1, rate_hz, pylsl.cf_double64, "numbered-1"))
    begun_s, number = pylsl.local_clock(), 0
    while True:
        while begun_s + number / rate_hz <= pylsl.local_clock():
            outlet.push_sample([float(number)], begun_s + number / rate_hz)
            number += 1
        time.sleep(0.01)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
