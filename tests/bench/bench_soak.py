"""Half an hour of the demo study: what is missing from the recording, and whether memory grows."""

import soak

DURATION_S = 1800.0


def rows() -> list[dict]:
    found = soak.run(DURATION_S)
    growth_mib, name = found.growth_mib
    samples = sum(stream["samples"] for stream in found.report["streams"])
    return [
        {
            "what": f"soak, {DURATION_S / 60:.0f} min of the demo study: samples missing from the recording",
            "target": "0 unexplained",
            "measured": f"{found.missing} of {samples}, {found.report['verdict']}",
            "ok": found.missing == 0,
        },
        {
            "what": f"soak: memory of any process after {soak.SETTLED:.0%} of the run",
            "target": f"flat (<= {soak.GROWTH_MIB:g} MiB)",
            "measured": f"{growth_mib:+.1f} MiB at most ({name})",
            "ok": growth_mib <= soak.GROWTH_MIB,
        },
    ]


if __name__ == "__main__":
    for row in rows():
        print(f"{row['what']}: {row['measured']} (target {row['target']})")
