"""A page on this machine that shows the latest picture as it changes (MJPEG)."""

from __future__ import annotations

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any, Self

import cv2

from tactibench import UserError
from tactibench_tactip.live.picture import Picture

HOST = "127.0.0.1"


class Page:
    """Listens on loopback alone. port 0: any that is free. Raises UserError for a taken one."""

    def __init__(self, port: int = 0) -> None:
        self._news = threading.Condition()
        self._jpeg, self._number, self._ended = b"", 0, False
        try:
            self._server = ThreadingHTTPServer((HOST, port), self._handler())
        except OSError as error:
            raise UserError(
                f"port {port} cannot be used ({error.strerror or error}); take another with --port."
            ) from None
        self._server.daemon_threads = True

    @property
    def url(self) -> str:
        return f"http://{HOST}:{self._server.server_address[1]}/"

    def __enter__(self) -> Self:
        threading.Thread(target=self._server.serve_forever, name="tactip page", daemon=True).start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._news:
            self._ended = True
            self._news.notify_all()
        self._server.shutdown()
        self._server.server_close()

    def show(self, picture: Picture) -> None:
        good, data = cv2.imencode(".jpg", picture)
        if good:
            with self._news:
                self._jpeg, self._number = data.tobytes(), self._number + 1
                self._news.notify_all()

    def _next(self, after: int) -> tuple[bytes, int]:
        with self._news:
            self._news.wait_for(lambda: self._number > after or self._ended, 1.0)
            return (b"" if self._ended else self._jpeg), self._number

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        page = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                number = 0
                try:
                    while True:
                        data, number = page._next(number)
                        if not data:
                            return
                        head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}"
                        self.wfile.write(head.encode() + b"\r\n\r\n" + data + b"\r\n")
                except OSError:  # the reader went away
                    return

            def log_message(self, *_: Any) -> None:
                """Nobody wants to read them."""

        return Handler
