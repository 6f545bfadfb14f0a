"""What Prometheus sees of one stream of a driver."""

import time

from sense4hri_msgs.msg import StreamHealth

from sense4hri.metrics import Metrics


class StreamMetrics:
    """What Prometheus sees of one stream."""

    def __init__(self, metrics: Metrics, sensor_type: str, sensor_id: str) -> None:
        self._gauge = metrics.gauge
        self._labels = labels = {"sensor_type": sensor_type, "sensor_id": sensor_id}
        self._samples = metrics.counter("samples", "Samples published.", **labels)
        text = "Samples missing by the device's time or count; 0 also where neither is known, then health says -1."
        self.lost = metrics.counter("lost_samples", text, **labels)
        self.gaps = metrics.counter("gaps", "Holes in the signal by device time.", **labels)
        self.duplicates = metrics.counter("duplicates", "Frames that came twice, by device time.", **labels)
        self._latency = metrics.histogram("latency_seconds", "From receipt to publication.", **labels)

    def published(self, n: int, received_ns: int) -> None:
        """Count n samples that were published just now, received together; without a latency after a clock set back."""
        self._samples.inc(n)
        latency_ns = time.time_ns() - received_ns
        if latency_ns >= 0:
            self._latency.observe(latency_ns * 1e-9)

    def show(self, health: StreamHealth) -> None:
        """Show what is told of the stream once a second."""
        for name, text, value in (
            ("stream_state", "0 starting, 1 connecting, 2 streaming, 3 lost, 4 stopping.", health.state),
            ("sampling_frequency_hertz", "Samples per second of host time.", health.measured_rate_hz),
            ("nominal_sampling_frequency_hertz", "Declared rate; 0 where irregular.", health.nominal_rate_hz),
            ("link_delay_seconds", "Delay of the newest frame beyond the smallest seen.", health.latency_s),
        ):
            self._gauge(name, text, **self._labels).set(value)
