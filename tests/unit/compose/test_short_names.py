"""What `make demo` says of streams is short enough to be read."""

import pytest
from short_names import short


@pytest.mark.parametrize(
    ("sentence", "said"),
    [
        ("/humans/physiological/p1/ecg/h10_1/raw: not heard yet", "p1/ecg/h10_1: not heard yet"),
        (
            "clock_sync: /humans/physiological/p1/ecg/h10_1/raw, /humans/physiological/p2/ppg/v_2/raw not heard yet",
            "clock_sync: p1/ecg/h10_1, p2/ppg/v_2 not heard yet",
        ),
        ("/humans/physiological/*/ecg/*/raw: nothing yet", "/humans/physiological/*/ecg/*/raw: nothing yet"),
        ("fusion_affect: no answer yet", "fusion_affect: no answer yet"),
    ],
)
def test_a_topic_is_said_as_its_stream(sentence: str, said: str) -> None:
    """Wherever it stands in the sentence; a pattern, which names no stream, stays as it is."""
    assert short(sentence) == said
