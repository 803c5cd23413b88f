"""The server: this machine alone, its own page alone, bounded input."""

from __future__ import annotations

import http.client
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from tactibench.errors import UserError
from tactibench.live import MOST_BYTES, LocalServer


def shout(body: bytes) -> bytes:
    if body == b"no":
        raise UserError("no is not understood.")
    return body.upper()


@pytest.fixture
def server() -> Iterator[LocalServer]:
    with LocalServer({"/": ("text/plain", b"hello")}, {"/shout": shout}) as made:
        yield made


def port_of(server: LocalServer) -> int:
    return int(server.url.rpartition(":")[2].rstrip("/"))


def ask(
    server: LocalServer, method: str, path: str, body: bytes | None = None, **headers: Any
) -> tuple[int, bytes, dict[str, str]]:
    connection = http.client.HTTPConnection("127.0.0.1", port_of(server), timeout=10)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    skip = "Host" in named
    connection.putrequest(method, path, skip_host=skip)
    if body is not None and "Content-Length" not in named:
        named["Content-Length"] = str(len(body))
    for name, value in named.items():
        connection.putheader(name, value)
    connection.endheaders(body)
    answer = connection.getresponse()
    out = answer.status, answer.read(), dict(answer.getheaders())
    connection.close()
    return out


def post(server: LocalServer, body: bytes, **headers: Any) -> tuple[int, bytes]:
    headers = {"Content_Type": "application/json", **headers}
    return ask(server, "POST", "/shout", body, **headers)[:2]


def test_many_slow_connections_leave_the_page_open(server: LocalServer) -> None:
    place = ("127.0.0.1", port_of(server))
    with ExitStack() as slow:
        for _ in range(100):
            half = slow.enter_context(socket.create_connection(place, timeout=10))
            half.sendall(b"POST /shout HTTP/1.1\r\nHost: local")
        assert ask(server, "GET", "/")[:2] == (200, b"hello")


def test_files_and_answers(server: LocalServer) -> None:
    assert ask(server, "GET", "/")[:2] == (200, b"hello")
    assert post(server, b"abc") == (200, b"ABC")
    assert post(server, b"no") == (400, b"no is not understood.")
    assert ask(server, "GET", "/elsewhere")[0] == 404
    assert ask(server, "GET", "/../etc/passwd")[0] == 404
    assert ask(server, "DELETE", "/")[0] == 501


def test_it_listens_on_loopback_alone(server: LocalServer) -> None:
    assert server._server.server_address[0] == "127.0.0.1"
    assert server.url.startswith("http://127.0.0.1:")


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1.evil.example", "127.0.0.1@evil.example"]
)
def test_another_host_is_refused(server: LocalServer, host: str) -> None:
    assert ask(server, "GET", "/", Host=host)[0] == 403
    assert post(server, b"abc", Host=host)[0] == 403


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST:9000", "127.0.0.1:1"])
def test_this_machine_by_any_of_its_names_is_answered(server: LocalServer, host: str) -> None:
    """Behind a tunnel (`ssh -L`) the port is another one."""
    assert ask(server, "GET", "/", Host=host)[0] == 200


def test_a_post_of_another_page_is_refused(server: LocalServer) -> None:
    own = server.url.rstrip("/")
    assert post(server, b"abc", Origin=own)[0] == 200
    for origin in ("http://evil.example", "null", own.replace("http", "https")):
        assert post(server, b"abc", Origin=origin)[0] == 403
    # A form of another site can send these without asking first.
    for kind in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        assert post(server, b"abc", Content_Type=kind)[0] == 415


@pytest.mark.parametrize("length", [str(MOST_BYTES + 1), "9" * 40, "-1", "1e3", "", "²"])
def test_a_body_is_bounded_before_it_is_read(server: LocalServer, length: str) -> None:
    assert post(server, b"", Content_Length=length.encode("latin-1"))[0] == 413


def test_every_answer_says_what_a_browser_may_do_with_it(server: LocalServer) -> None:
    for path in ("/", "/elsewhere"):
        headers = ask(server, "GET", path)[2]
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert "Access-Control-Allow-Origin" not in headers


def test_a_taken_port_is_a_sentence(server: LocalServer) -> None:
    with pytest.raises(UserError, match=r"port \d+ cannot be used .*; take another with --port"):
        LocalServer({}, {}, port_of(server))
