"""From which bound on something is told: the alerts of `compose/prometheus/rules.yml`, for a study without Prometheus.

A test compares this table with that file. Pure.
"""

from typing import NamedTuple


class Rule(NamedTuple):
    """One alert. A value that is `sign` than `bound` breaks it; it is told once it has been broken for `for_s`.

    sign: `<`, `>`, `==`, or empty where no number is judged. window_s: over which a counter's growth is the value.
    severity: `error`, data are being lost; `warning`, they soon will be, or are worth less.
    """

    name: str
    sign: str
    bound: float
    severity: str = "warning"
    for_s: float = 0.0
    window_s: float = 0.0

    def broken(self, value: float | None) -> bool:
        """True where a value is beyond the bound; never for one that is not known (None or NaN)."""
        if value is None:
            return False
        return {"<": value < self.bound, ">": value > self.bound, "==": value == self.bound}.get(self.sign, False)


RULES = {
    rule.name: rule
    for rule in (
        Rule("StreamSilent", "==", 3, "error"),  # StreamHealth.LOST
        Rule("SensorNotFound", "==", 1, for_s=60),  # StreamHealth.CONNECTING
        Rule("RateLow", "<", 0.9, for_s=5),  # of the nominal rate
        Rule("SamplesLost", ">", 0, window_s=60),
        Rule("LatencyGrowing", ">", 0.1),  # s, 99th percentile
        Rule("LinkBehind", ">", 1, for_s=5),  # s
        Rule("ClockUnlocked", "==", 2),  # ClockModel.HOLDOVER
        Rule("ClockNotFound", "==", 0, for_s=60),  # ClockModel.WARMUP
        Rule("HostClocksApart", ">", 0.001),  # s
        Rule("HostUnanswering", "==", 2, for_s=5),  # HostClock.HOLDOVER
        Rule("NetworkSlow", ">", 0.05, for_s=5),  # s, there and back
        Rule("BatteryLow", "<", 0.2),  # of full
        Rule("ContactLost", "<", 0.5),  # 0 = off the skin
        Rule("RecorderCannotRecord", "==", 0, "error"),  # ready
        Rule("DiskFilling", "<", 1800),  # s
        Rule("MessagesLost", ">", 0, "error", window_s=60),
        Rule("RecorderBehind", ">", 3),  # s
        Rule("MessagesDropped", ">", 0, "error", window_s=60),
        Rule("ServiceNotReady", "==", 0, for_s=5),  # ready
        Rule("ServiceDown", "", 0, "error"),
        Rule("ServiceUnanswering", "==", 0, "error"),  # up
        Rule("ServiceRestarting", ">", 0),
    )
}
