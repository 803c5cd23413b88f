"""The page: frames as they come, or presses by hand."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tactibench.errors import UserError
from tactibench.live import press
from tactibench.live.server import JSON, LocalServer, Post
from tactibench.live.views import FrameView, pack

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


class _Next(BaseModel):
    """The number of the last frame that a page has shown."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    after: int = Field(ge=0, le=2**53)


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
        try:
            after = _Next.model_validate_json(body).after
        except ValidationError:
            raise UserError("the request names no frame; load the page again.") from None
        with self._news:
            self._news.wait_for(lambda: self._number != after or self._ended, PATIENCE_S)
            if self._number != after:
                return self._message
            return pack({"number": self._number, "ended": self._ended}, {})


def _asset(name: str) -> bytes:
    return (files("tactibench.live") / "assets" / name).read_bytes()
