"""`lostlink aps status --url` beside what is no daemon: a line says so, and the others are shown."""

from __future__ import annotations

import io
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from rich.console import Console

from aps.status_view import LEGEND, TROUBLES, ask_over_http, tables, watch


@contextmanager
def answering(*replies: bytes) -> Iterator[str]:
    """A server that answers a request with each of these, and its URL."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            for reply in replies:
                connection, _ = server.accept()
                with connection:
                    connection.recv(4096)
                    connection.sendall(reply)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}"
        thread.join()


def shown(url: str) -> str:
    console = Console(width=300, record=True, file=io.StringIO())
    console.print(tables(list(ask_over_http([url], ""))))
    return console.export_text()


def ok(body: bytes, length: int | None = None) -> bytes:
    return b"HTTP/1.1 200 OK\r\nContent-Length: %d\r\n\r\n%s" % (length or len(body), body)


@pytest.mark.parametrize(
    ("reply", "why"),
    [
        (b"SSH-2.0-[/b]\r\n", "this is not HTTP: BadStatusLine"),
        (ok(b"{}", 9), "this is not HTTP: IncompleteRead"),
        (ok(b"[1]"), "not a JSON object"),
        (ok(b'{"sysid": 1}'), "not that of a daemon"),
        (ok(b'{"sysid": 1, "state": {}, "statistics": []}'), "not that of a daemon"),
    ],
)
def test_an_answer_of_something_else_is_told(reply: bytes, why: str) -> None:
    with answering(reply) as url:
        assert why in shown(url)


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("http://[::1", "Invalid IPv6 URL"),
        ("http://a b", "InvalidURL"),
        ("ftp://127.0.0.1/x", "http:// or https:// is expected, not ftp:"),
    ],
)
def test_a_url_that_is_none_is_told(url: str, why: str) -> None:
    assert why in shown(url)


def busy(after: bytes) -> bytes:
    return b"HTTP/1.1 429 Too Many Requests\r\nRetry-After: %s\r\nContent-Length: 0\r\n\r\n" % after


def test_one_that_is_busy_is_asked_again_when_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    slept: list[float] = []
    monkeypatch.setattr("time.sleep", slept.append)
    with answering(busy(b"1"), busy(b"86400"), ok(b'{"sysid": 7}')) as url:
        (told,) = ask_over_http([url], "")
    assert (told["sysid"], slept) == (7, [1.0, 5.0])
    with answering(*[busy(b"1")] * 5) as url:
        (told,) = ask_over_http([url], "")
    assert (told["error"], len(slept)) == ("HTTP Error 429: Too Many Requests", 6)
    with answering(busy(b"Tue, 24 Nov 2026 08:00:00 GMT")) as url:
        (told,) = ask_over_http([url], "")
    assert (told["error"], len(slept)) == ("HTTP Error 429: Too Many Requests", 6)


def test_a_file_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "status").write_text('{"secret": 1}')
    (told,) = ask_over_http([tmp_path.as_uri()], "")
    assert "not file:" in told["error"]
    assert "secret" not in told


def test_the_token_does_not_follow_a_redirect() -> None:
    with socket.create_server(("127.0.0.1", 0)) as elsewhere:
        elsewhere.settimeout(0.0)
        place = b"http://127.0.0.1:%d/status" % elsewhere.getsockname()[1]
        with answering(b"HTTP/1.1 302 Found\r\nLocation: %s\r\nContent-Length: 0\r\n\r\n" % place) as url:
            (told,) = ask_over_http([url], "0123456789abcdef-token")
        assert told["error"] == f"it sends elsewhere, which is not followed: {place.decode()}"
        with pytest.raises(BlockingIOError):
            elsewhere.accept()


def test_what_the_columns_mean_is_said_below_them_and_a_peer_is_shown_as_it_is() -> None:
    outbox = dict.fromkeys(("written_frames", "dropped_full", "stalls"), 0)
    framer = dict.fromkeys(("bad_crc", "skipped_bytes"), 0)
    link = {
        "role": "client",
        "link": 1,
        "peer": "tcp:[fe80::1]:5760",
        "up": True,
        "rate_in_hz": 1.0,
        "frames_in": 2,
    }
    link |= dict.fromkeys(("lost_in", "throttled", "dropped_rate", "dropped_in", "dropped_out"), 0)
    link |= {"outbox": outbox, "framer": framer}
    state = {"heartbeat_age_s": 1.0, "mode": "GUIDED", "armed": False}
    statistics = {
        "routes": {},
        "autopilot_links": [link],
        "clients": [],
        "other_systems": [],
        "turned_away": 0,
    }
    told = {"name": "6760", "sysid": 1, "state": state, "statistics": statistics}
    console = Console(width=300, record=True, file=io.StringIO())
    console.print(tables([told]))
    text = console.export_text()
    assert text.count("tcp:[fe80::1]:5760") == 2
    for column in ("turned away", "loops", "no route", "up", "ms", "lost", *TROUBLES):
        assert column in LEGEND
        assert column in text


def test_a_file_gets_a_table_at_each_look(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted_at_the_third(_: float) -> None:
        if next(looks) == 2:
            raise KeyboardInterrupt

    looks = iter(range(1, 3))
    monkeypatch.setattr("aps.status_view.time.sleep", interrupted_at_the_third)
    with answering(b"SSH\r\n", b"SSH\r\n") as url:
        assert watch(1.0, once=False, as_json=False, urls=[url]) == 1
    assert capsys.readouterr().out.count("this is not HTTP") == 2
