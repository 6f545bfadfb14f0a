"""Offset from measurements a link makes of itself in both directions: a Kalman filter of offset and skew.

Their error is symmetric (half the asymmetry of the path), so a mean-type filter is right here, as it is wrong for
one-way delays.
"""

from __future__ import annotations

import math

SKEW_SIGMA = 100e-6
SKEW_WALK = 5e-7  # the skew's random walk, per square root of a second: 5 ppm in 100 s
LEAST_SIGMA_S = 2e-5
UNKNOWN_SIGMA_S = 5e-3  # where a driver does not say how good a measurement is
STEP_SIGMAS, STEP_S = 6.0, 2e-3


class TwoWay:
    """`y(tau)`, receipt clock minus device clock in s, from measured pairs."""

    def __init__(self) -> None:
        self.tau_s: float | None = None
        self.level_s = self.skew = 0.0
        self._var_level = self._cov = self._var_skew = 0.0
        self._odd: tuple[float, float] | None = None

    def add(self, tau_s: float, y_s: float, uncertainty_s: float) -> bool:
        """Take one measurement in (95 % half width). True where two in a row say that the clock has stepped."""
        known = math.isfinite(uncertainty_s) and uncertainty_s > 0
        sigma = max(uncertainty_s / 2, LEAST_SIGMA_S) if known else UNKNOWN_SIGMA_S
        if self.tau_s is None:
            self.tau_s, self.level_s = tau_s, y_s
            self._var_level, self._var_skew = sigma * sigma, SKEW_SIGMA**2
            return False
        innovation = y_s - self.at(tau_s)
        spread = math.hypot(self.sigma_s(tau_s), sigma)
        if abs(innovation) > STEP_SIGMAS * spread + STEP_S:
            before, self._odd = self._odd, (tau_s, y_s)
            return before is not None and abs(y_s - before[1]) < STEP_SIGMAS * spread + STEP_S
        self._odd = None
        self._move_to(tau_s)
        total = self._var_level + sigma * sigma
        gain, skew_gain = self._var_level / total, self._cov / total
        self.level_s += gain * innovation
        self.skew += skew_gain * innovation
        self._var_skew -= skew_gain * self._cov
        self._cov *= 1 - gain
        self._var_level *= 1 - gain
        return False

    def at(self, tau_s: float) -> float:
        assert self.tau_s is not None
        return self.level_s + self.skew * (tau_s - self.tau_s)

    def sigma_s(self, tau_s: float) -> float:
        assert self.tau_s is not None
        x = tau_s - self.tau_s
        walk = SKEW_WALK**2 * abs(x) ** 3 / 3
        return math.sqrt(max(self._var_level + 2 * x * self._cov + x * x * self._var_skew + walk, 0.0))

    def _move_to(self, tau_s: float) -> None:
        assert self.tau_s is not None
        x = tau_s - self.tau_s
        if x <= 0:
            return
        walk = SKEW_WALK**2
        self._var_level += 2 * x * self._cov + x * x * self._var_skew + walk * x**3 / 3
        self._cov += x * self._var_skew + walk * x * x / 2
        self._var_skew += walk * x
        self.level_s, self.tau_s = self.at(tau_s), tau_s
