"""Prometheus metrics of a service, as its HTTP port shows them.

Names are `sense4hri_` + quantity + base unit (+ `_total`); labels are `service`, `sensor_type`, `sensor_id` and
`field`. Never a human_id: whoever reads the metrics must not learn who takes part. All of them: docs/metrics.md.
"""

import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import prometheus_client
from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client import process_collector as process
from prometheus_client.core import CounterMetricFamily

LABELS = ("sensor_type", "sensor_id", "field")
LATENCY_BUCKETS_S = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 1.0)
MOST_SERIES = 1000
"""Label sets of one metric; what comes after them is counted under `other`, while none of them has gone."""
OTHER = "other"

prometheus_client.disable_created_metrics()  # nobody reads when a counter was made, and it is a series of each


class Metrics:
    """The registry of one service; `service` is preset as a label of everything made here, on any thread."""

    def __init__(self, service: str) -> None:
        self._service = service
        self._registry = CollectorRegistry()
        process.ProcessCollector(registry=self._registry)
        self._lock = threading.Lock()
        self._made: dict[str, Counter | Gauge | Histogram] = {}
        self._children: dict[str, dict[tuple[str, ...], Any]] = {}
        self._gone: dict[str, dict[tuple[str, ...], None]] = {}  # those of them that make room, gone longest first
        self._used: dict[str, list[str]] = {}  # labels of each metric, in their order

    def counter(self, name: str, text: str, **labels: str) -> Counter:
        """Return the child `sense4hri_<name>_total` with these labels; made at first use."""
        return self._child(Counter, name, text, labels)

    def gauge(self, name: str, text: str, **labels: str) -> Gauge:
        """Return the child `sense4hri_<name>` with these labels; made at first use."""
        return self._child(Gauge, name, text, labels)

    def histogram(self, name: str, text: str, **labels: str) -> Histogram:
        """Return the child `sense4hri_<name>` with these labels and latency buckets in s; made at first use."""
        return self._child(Histogram, name, text, labels)

    def counted(self, name: str, text: str, count: Callable[[], float]) -> None:
        """Show `sense4hri_<name>_total` as count() says when asked, on any thread; it must never become less."""
        self._registry.register(_Counted(f"sense4hri_{name}", text, self._service, count))

    def gone(self, **labels: str) -> None:
        """What bears these labels has gone: its series stay as they are until others need their room."""
        with self._lock:
            for name, used in self._used.items():
                named = {values: dict(zip(used, values, strict=True)) for values in self._children[name]}
                leaving = (values for values, borne in named.items() if labels.items() <= borne.items())
                self._gone[name].update(dict.fromkeys(leaving))

    def text(self) -> bytes:
        """Return everything in Prometheus' text format."""
        return generate_latest(self._registry)

    def _child(self, kind: type[Counter | Gauge | Histogram], name: str, text: str, labels: dict[str, str]) -> Any:
        unknown = set(labels) - set(LABELS)
        if unknown:
            raise ValueError(f"labels {sorted(unknown)} are not of the contract; use {', '.join(LABELS)}")
        used = sorted(labels, key=LABELS.index)
        values = tuple(labels[label] for label in used)
        with self._lock:
            if name not in self._made:
                self._make(kind, name, text, used)
            children = self._children[name]
            if values not in children:
                if not self._has_room(name):
                    return self._made[name].labels(self._service, *[OTHER] * len(used))
                children[values] = self._made[name].labels(self._service, *values)
            self._gone[name].pop(values, None)
            return children[values]

    def _make(self, kind: type[Counter | Gauge | Histogram], name: str, text: str, used: list[str]) -> None:
        extra: dict[str, Any] = {"buckets": LATENCY_BUCKETS_S} if kind is Histogram else {}
        names: Sequence[str] = ("service", *used)
        self._made[name] = kind(f"sense4hri_{name}", text, names, registry=self._registry, **extra)
        self._children[name], self._gone[name], self._used[name] = {}, {}, used

    def _has_room(self, name: str) -> bool:
        """Whether one more label set can be kept: where as many are as may be, one that has gone makes room."""
        if len(self._children[name]) < MOST_SERIES:
            return True
        leaving = next(iter(self._gone[name]), None)
        if leaving is not None:
            self._made[name].remove(self._service, *leaving)
            del self._children[name][leaving], self._gone[name][leaving]
        return leaving is not None


class _Counted:
    """A counter that somebody else keeps."""

    def __init__(self, name: str, text: str, service: str, count: Callable[[], float]) -> None:
        self._name, self._text, self._service, self._count = name, text, service, count

    def collect(self) -> Iterator[CounterMetricFamily]:
        """Yield the counter with the number that it has now."""
        family = CounterMetricFamily(self._name, self._text, labels=["service"])
        family.add_metric([self._service], self._count())
        yield family
