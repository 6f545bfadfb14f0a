"""When nothing was recorded, and why."""

from sense4hri_report.outages import joined
from sense4hri_report.watch import Span


def test_of_two_reasons_for_one_time_the_first_in_the_list_is_told():
    """A silence that begins a moment before the pause of the recorder is that pause; what is apart stays apart."""
    ran, silent, later = Span(101, 200, "no recorder ran"), Span(100, 198, "silence"), Span(300, 400, "silence")
    assert joined([ran, silent, later]) == [Span(100, 200, "no recorder ran"), later]
    assert joined([silent, ran]) == [Span(100, 200, "silence")]


def test_one_time_may_have_many_parts():
    """Each touches the one before; the reason is that of the first in the list, wherever it lies."""
    told = Span(5, 6, "no recorder ran")
    assert joined([told, Span(0, 3, "silence"), Span(3, 5, "silence")]) == [Span(0, 6, "no recorder ran")]
