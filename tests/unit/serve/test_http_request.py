"""What a browser may ask, and what nobody may."""

import pytest

from imu_tracker.serve.http_request import Refused, parse


def head(line: str = "GET / HTTP/1.1", *fields: str, host: str = "localhost") -> bytes:
    return "\r\n".join([line, f"Host: {host}", *fields, "", ""]).encode("latin-1")


def test_a_path_a_token_and_a_cookie_are_read() -> None:
    request = parse(
        head("GET /events?token=abc HTTP/1.1", "Cookie: a=b; imu-tracker=xyz"), ()
    )
    assert request == ("/events", "abc", "xyz", False)


@pytest.mark.parametrize(
    "host",
    [
        "localhost:8086",
        "127.0.0.1",
        "[::1]:8086",
        "192.168.1.7:80",
        "PI.local",
        "pi.me",
    ],
)
def test_names_that_nobody_else_can_have_are_ours(host: str) -> None:
    assert parse(head(host=host), ("pi.me",)).path == "/"


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:8086", "", "a@b", "x y"]
)
def test_a_name_of_somebody_else_is_refused(host: str) -> None:
    with pytest.raises(Refused, match="421"):
        parse(head(host=host), ("pi.me",))


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "CONNECT"])
def test_nothing_but_reading_is_allowed(method: str) -> None:
    with pytest.raises(Refused, match="405"):
        parse(head(f"{method} / HTTP/1.1"), ())


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"GET /\r\n\r\n",
        b"\x16\x03\x01\x02\x00",
        b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        b"GET / HTTP/1.1\r\nBad Field: a\r\n\r\n",
        b"GET http://[/ HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ],
)
def test_nonsense_is_a_bad_request(text: bytes) -> None:
    with pytest.raises(Refused, match="400"):
        parse(text, ())
