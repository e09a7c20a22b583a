"""How much of a record is in memory while it is exported."""

from lostlink.export.mcap.export import _window_ns

HOUR_NS = 3600 * 10**9


def test_windows_of_many_ua_are_shorter_as_their_rows_go_with_the_links() -> None:
    assert _window_ns(HOUR_NS, 2) == _window_ns(HOUR_NS, 40) == 5_000_000_000
    assert _window_ns(HOUR_NS, 100) == 1_000_000_000
    assert _window_ns(10**19, 2) == 10**14
