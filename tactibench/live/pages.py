"""The page, frames as they come or presses by hand, and its web server for one person.

The server listens on loopback alone. A request must name this machine as its host, so that no other
site can reach it by a name of its own (DNS rebinding). A POST must come from the page itself. The
size of a request is bounded before it is read.
"""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any, Self

from tactibench.errors import UserError
from tactibench.live import press
from tactibench.live.views import FrameView, pack

HOST = "127.0.0.1"
NAMES = frozenset({HOST, "localhost"})
"""Names of this machine in a Host header. Any port is accepted: a tunnel may have another one."""
MOST_BYTES = 4096
"""Largest body of a POST: five tips and five sliders take a tenth of it."""
IDLE_S = 60.0
"""Time after which a silent connection is closed; the browser opens another."""
JSON = "application/json"
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}

Files = Mapping[str, tuple[str, bytes]]
"""Path -> content type and content."""
Post = Callable[[bytes], bytes]
"""Body of a request -> body of the answer. It raises UserError for a body that is not valid."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 128  # of 5, the default, many that connect at once leave none for the page

    def handle_error(self, *_: Any) -> None:
        """Report nothing: the reader closed the connection."""


class LocalServer:
    """Files and answers to POSTs, served from entry to exit.

    Attributes:
        url: Address of the page.
    """

    def __init__(self, files: Files, posts: Mapping[str, Post], port: int = 0) -> None:
        """Take the port.

        Args:
            files: Answers to GETs, by path.
            posts: Answers to POSTs, by path. They are called in several threads.
            port: Port to take; 0: any that is free.

        Raises:
            UserError: The port is taken.
        """
        try:
            self._server = _Server((HOST, port), _handler(files, posts))
        except OSError as error:
            raise UserError(
                f"port {port} cannot be used ({error.strerror or error}); take another with --port."
            ) from None
        self.url = f"http://{HOST}:{self._server.server_address[1]}/"

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, name="live page", daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()


class _RefusedError(Exception):
    def __init__(self, status: HTTPStatus, why: str) -> None:
        super().__init__(why)
        self.status = status


def _handler(files: Files, posts: Mapping[str, Post]) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"  # the connection stays open from picture to picture
        server_version, sys_version = "tactibench", ""
        disable_nagle_algorithm = True

        def setup(self) -> None:
            self.request.settimeout(IDLE_S)
            super().setup()

        def do_GET(self) -> None:
            self._answer(lambda: files.get(self.path))

        def do_POST(self) -> None:
            self._answer(self._post)

        def _post(self) -> tuple[str, bytes] | None:
            answer = posts.get(self.path)
            if answer is None:
                return None
            origin = self.headers.get("Origin")
            if origin is not None and origin != f"http://{self.headers.get('Host')}":
                raise _RefusedError(HTTPStatus.FORBIDDEN, "only its own page may ask this")
            if self.headers.get_content_type() != JSON:
                raise _RefusedError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"send {JSON}")
            length = self.headers.get("Content-Length", "")
            if not re.fullmatch(r"[0-9]{1,4}", length) or int(length) > MOST_BYTES:
                why = f"a body may have {MOST_BYTES} bytes, and its length must be named"
                raise _RefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, why)
            return "application/octet-stream", answer(self.rfile.read(int(length)))

        def _answer(self, make: Callable[[], tuple[str, bytes] | None]) -> None:
            try:
                if not _is_local(self.headers.get_all("Host") or []):
                    raise _RefusedError(HTTPStatus.FORBIDDEN, "this page is for this machine alone")
                content = make()
                if content is None:
                    raise _RefusedError(HTTPStatus.NOT_FOUND, "there is nothing at this address")
            except _RefusedError as refused:
                self.close_connection = True  # its body was not read
                self._send(refused.status, "text/plain; charset=utf-8", str(refused).encode())
            except UserError as error:
                self._send(HTTPStatus.BAD_REQUEST, "text/plain; charset=utf-8", str(error).encode())
            else:
                self._send(HTTPStatus.OK, *content)

        def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
            self.send_response(status)
            for name, value in HEADERS.items():
                self.send_header(name, value)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            if self.close_connection:
                self.send_header("Connection", "close")
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: Any) -> None:
            """Write no log: nobody would read it."""

    return Handler


def _is_local(hosts: list[str]) -> bool:
    """Return whether exactly one Host header names this machine."""
    if len(hosts) != 1:
        return False
    name, _, port = hosts[0].partition(":")
    return name.lower() in NAMES and re.fullmatch(r"[0-9]*", port) is not None


PATIENCE_S = 1.0
"""Time after which a page that waits for the next frame is answered without one; it asks again."""
KINDS = {"page.html": "text/html", "page.css": "text/css", "page.js": "text/javascript"}
GREY = "#595959"


class _Page(LocalServer):
    """The page with its own settings."""

    def __init__(self, settings: Mapping[str, Any], posts: Mapping[str, Post], port: int) -> None:
        """Take the port.

        Args:
            settings: JSON values that page.js reads.
            posts: Answers to POSTs, by path.
            port: Port to take; 0: any that is free.

        Raises:
            UserError: The port is taken.
        """
        content = {
            f"/{name}": (f"{kind}; charset=utf-8", _asset(name)) for name, kind in KINDS.items()
        }
        content["/"] = content.pop("/page.html")
        content["/settings.json"] = (JSON, json.dumps(settings).encode())
        super().__init__(content, posts, port)


class PressPage(_Page):
    """A page on which somebody presses a simulated sensor."""

    def __init__(
        self,
        session: press.PressSession,
        models: Sequence[tuple[str, str]],
        *,
        sensor: str,
        half_mm: float,
        learned_mm: float,
        dome_mm: float,
        instances: bool,
        port: int = 0,
    ) -> None:
        """Take the port.

        Args:
            session: Answers presses.
            models: Label and colour of every model.
            sensor: Name of the sensor.
            half_mm: Half the side of the maps.
            learned_mm: Largest x and y, either way, at which the models learned.
            dome_mm: Radius of the dome; 0: the sensor is flat.
            instances: Whether the sensor has other instances.
            port: Port to take; 0: any that is free.

        Raises:
            UserError: The port is taken.
        """
        settings = {
            "kind": "press",
            "models": [{"label": label, "colour": colour} for label, colour in models],
            "sensor": sensor,
            "half_mm": half_mm,
            "learned_mm": learned_mm,
            "dome_mm": dome_mm,
            "most_tips": press.MOST_TIPS,
            "ranges": {
                "depth": press.DEPTH_MM,
                "radius": press.RADIUS_MM,
                "light": press.LIGHT,
                "shift": press.SHIFT_PX,
                "instance": (0, press.LAST_INSTANCE if instances else 0),
            },
        }
        answer = {"/press": lambda body: session.press(press.PressRequest.read(body))}
        super().__init__(settings, answer, port)


class WatchPage(_Page):
    """A page that shows the newest frame of a camera, and the answer of a model to it."""

    def __init__(self, label: str, half_mm: float, port: int = 0) -> None:
        """Take the port.

        Args:
            label: Label of the model.
            half_mm: Half the side of the maps.
            port: Port to take; 0: any that is free.

        Raises:
            UserError: The port is taken.
        """
        self._news = threading.Condition()
        self._message, self._number, self._ended = b"", 0, False
        settings = {
            "kind": "watch",
            "models": [{"label": label, "colour": GREY}],
            "half_mm": half_mm,
        }
        super().__init__(settings, {"/next": self._next}, port)

    def __exit__(self, *_: object) -> None:
        with self._news:
            self._ended = True
            self._news.notify_all()
        super().__exit__()

    def show(self, view: FrameView) -> None:
        """Send a frame to every open page."""
        with self._news:
            self._number += 1
            self._message = view.message(self._number)
            self._news.notify_all()

    def _next(self, body: bytes) -> bytes:
        if not re.fullmatch(rb'\{"after": ?[0-9]{1,15}\}', body):
            raise UserError("the request names no frame; load the page again.")
        after = json.loads(body)["after"]
        with self._news:
            self._news.wait_for(lambda: self._number != after or self._ended, PATIENCE_S)
            if self._number != after:
                return self._message
            return pack({"number": self._number, "ended": self._ended}, {})


def _asset(name: str) -> bytes:
    return (files("tactibench.live") / "assets" / name).read_bytes()
