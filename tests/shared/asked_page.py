"""A page on this machine asked without a browser."""

from __future__ import annotations

import http.client
from urllib.parse import urlsplit


def ask_page(url: str, path: str, body: bytes | None = None) -> tuple[bytes, str]:
    """Return content and content type: of a GET, or of a POST of JSON."""
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=10)
    headers = {} if body is None else {"Content-Type": "application/json"}
    connection.request("GET" if body is None else "POST", path, body, headers)
    answer = connection.getresponse()
    assert answer.status == 200
    content, kind = answer.read(), answer.headers["Content-Type"]
    connection.close()
    return content, kind
