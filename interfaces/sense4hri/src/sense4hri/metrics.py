"""Prometheus metrics of a service, and the one HTTP port that shows them.

Names are `sense4hri_` + quantity + base unit (+ `_total`); labels are `service`, `sensor_type`, `sensor_id` and
`field`. Never a human_id: whoever reads the metrics must not learn who takes part.
"""

from collections.abc import Sequence
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client import process_collector as process

LABELS = ("sensor_type", "sensor_id", "field")
LATENCY_BUCKETS_S = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0)


class Metrics:
    """The registry of one service; `service` is preset as a label of everything made here."""

    def __init__(self, service: str) -> None:
        self._service = service
        self._registry = CollectorRegistry()
        process.ProcessCollector(registry=self._registry)
        self._made: dict[str, Counter | Gauge | Histogram] = {}

    def counter(self, name: str, text: str, **labels: str) -> Counter:
        """Return the child `sense4hri_<name>_total` with these labels; made at first use."""
        return self._child(Counter, name, text, labels)  # type: ignore[return-value]

    def gauge(self, name: str, text: str, **labels: str) -> Gauge:
        """Return the child `sense4hri_<name>` with these labels; made at first use."""
        return self._child(Gauge, name, text, labels)  # type: ignore[return-value]

    def histogram(self, name: str, text: str, **labels: str) -> Histogram:
        """Return the child `sense4hri_<name>` with these labels and latency buckets in s; made at first use."""
        return self._child(Histogram, name, text, labels)  # type: ignore[return-value]

    def text(self) -> bytes:
        """Return everything in Prometheus' text format."""
        return generate_latest(self._registry)

    def _child(
        self, kind: type[Counter | Gauge | Histogram], name: str, text: str, labels: dict[str, str]
    ) -> Counter | Gauge | Histogram:
        unknown = set(labels) - set(LABELS)
        if unknown:
            raise ValueError(f"labels {sorted(unknown)} are not of the contract; use {', '.join(LABELS)}")
        if name not in self._made:
            extra: dict[str, Any] = {"buckets": LATENCY_BUCKETS_S} if kind is Histogram else {}
            names: Sequence[str] = ("service", *sorted(labels, key=LABELS.index))
            self._made[name] = kind(f"sense4hri_{name}", text, names, registry=self._registry, **extra)
        return self._made[name].labels(service=self._service, **labels)
