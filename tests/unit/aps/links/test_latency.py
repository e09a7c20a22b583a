"""Round trips of TIMESYNC."""

from aps.links.latency import MAX_UNANSWERED, WINDOW, LinkLatency

MS = 1_000_000


def test_round_trips_are_told_apart_from_answers_to_others():
    latency = LinkLatency()
    assert latency.statistics() == {
        "asked": 0,
        "answered": 0,
        "latest_ms": None,
        "least_ms": None,
        "median_ms": None,
        "most_ms": None,
    }
    for begin, took in ((1000, 3), (2000, 1), (3000, 8)):
        assert latency.ask(begin * MS) == begin * MS
        assert not latency.answer((begin + 1) * MS, (begin + took) * MS)
        assert latency.answer(begin * MS, (begin + took) * MS)
        assert not latency.answer(begin * MS, (begin + took) * MS)
    told = latency.statistics()
    assert (told["asked"], told["answered"]) == (3, 3)
    assert [told[f"{name}_ms"] for name in ("latest", "least", "median", "most")] == [8.0, 1.0, 3.0, 8.0]


def test_answers_that_come_late_or_never():
    latency = LinkLatency()
    for number in range(3 * MAX_UNANSWERED):
        latency.ask(number)
    assert not latency.answer(0, 10 * MS)
    assert latency.answer(3 * MAX_UNANSWERED - 1, 10 * MS)
    for number in range(1, 3 * WINDOW):
        latency.answer(latency.ask(number * MS), number * MS + number)
    assert latency.statistics()["least_ms"] == round((2 * WINDOW) / MS, 3)
