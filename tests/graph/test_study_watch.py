"""What `make demo` sees of the graph, where anybody may publish."""

import math

from processes import poll
from sense4hri import qos
from sense4hri.names import StreamName
from sense4hri_msgs.msg import ClockModel, PhysioRaw, PhysioRawChannel
from study_watch import StudyWatch

STREAM = StreamName("p1", "ecg", "x_1")
TRUTH = {"devices": {"x_1": {"reference_host_ns": 1, "reference_device_ns": 1, "skew_ppm": 1.0}}}


def test_what_no_driver_would_publish_ends_no_demo(ears):
    """Raw data without a channel have no samples, and a clock without a skew is none; what is right counts."""
    raw = ears.node.create_publisher(PhysioRaw, STREAM.topic("raw"), qos.RAW)
    clock = ears.node.create_publisher(ClockModel, STREAM.topic("clock"), qos.CLOCK)
    channel = PhysioRawChannel(channel_name="ecg", samples=[1.0, 2.0])
    watch = StudyWatch()
    try:

        def samples() -> bool:
            for message in (PhysioRaw(), PhysioRaw(channels=[channel])):
                raw.publish(message)
            clock.publish(ClockModel(skew_ppm=math.nan))
            watch.spin(0.1)
            return not watch.line().startswith(("0 streams", "1 streams, 0 samples"))

        poll(samples, "samples are counted")
        (row,) = (line for line in watch.summary(TRUTH, {}).splitlines() if line.startswith("p1/ecg/x_1"))
        assert row.split()[-1] == "–"
    finally:
        watch.close()
