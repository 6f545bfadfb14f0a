"""What a program that reads LSL by MNE-LSL has of a stream, as JSON: mne_lsl_listener.py NAME SAMPLES

An environment with LSLAPICFG says in which session of LSL it looks. It ends when so many samples came.
"""

import json
import sys
import time

from mne_lsl.stream import StreamLSL

BUFFER_S, DEADLINE_S, PAUSE_S = 60.0, 60.0, 0.05


def main() -> None:
    """Connect, wait for the samples, print what they are."""
    name, wanted = sys.argv[1], int(sys.argv[2])
    stream = StreamLSL(BUFFER_S, name=name).connect(PAUSE_S, timeout=DEADLINE_S)
    print("connected", file=sys.stderr, flush=True)
    deadline_s = time.monotonic() + DEADLINE_S
    while stream.n_new_samples < wanted and time.monotonic() < deadline_s:
        time.sleep(PAUSE_S)
    samples, stamps_s = stream.get_data()
    came = stamps_s > 0  # the rest of the buffer is empty
    told = {
        "fs_hz": stream.info["sfreq"],
        "channels": stream.ch_names,
        "types": stream.get_channel_types(),
        "units": [[int(unit), int(power)] for unit, power in stream.get_channel_units()],
        "type": stream.stype,
        "samples": samples[:, came].T.tolist(),
        "stamps_s": stamps_s[came].tolist(),
    }
    stream.disconnect()
    print(json.dumps(told))


if __name__ == "__main__":
    main()
