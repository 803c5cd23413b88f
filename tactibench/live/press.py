"""Presses of a simulated sensor by hand, and the answers of models to them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tactibench.contacts import Contacts, Frame, Grid
from tactibench.errors import PluginError, UserError, call_plugin
from tactibench.frames import move, scale
from tactibench.geometry import scene_of_contacts, true_contacts
from tactibench.images import gray
from tactibench.live.views import AnswerView, FrameView, Maps, PinLines, ask
from tactibench.plugins import Encoder, Model, Sensor
from tactibench.protocols import first_mistake

MOST_TIPS = 5
"""Most tips of a press: as many as a hand has fingers."""
BESIDE_MM = 20.0
"""Largest x and y, either way, that a request may name; the page asks for less."""
DEPTH_MM = (0.1, 4.0)
"""Range of the depth; the simulator's tables end at 4 mm."""
RADIUS_MM = (2.0, 8.0)
LIGHT = (0.3, 1.7)
"""Range of the factor on every grey level: from a third of the light to tips saturated at white."""
SHIFT_PX = (-4.0, 4.0)
"""Range of the image's shift. Pins of a frame of 128 px lie about 9 px apart."""
LAST_INSTANCE = 20
OPEN_SENSORS = 4
"""Sensor instances that stay open; making one takes a twentieth of a second."""

Millimetres = Annotated[float, Field(ge=-BESIDE_MM, le=BESIDE_MM)]


class PressRequest(BaseModel):
    """A press as the page asks for it.

    Attributes:
        tips: (x, y) of every tip, mm.
        depth: Depth of every tip past its own first touch, mm.
        radius: Radius of every tip, mm.
        light: Factor on every grey level of the frame.
        shift: Shift of the frame's image to the right, px.
        instance: Number of the sensor instance; 0: the nominal one.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, strict=True)

    tips: Annotated[
        list[Annotated[list[Millimetres], Field(min_length=2, max_length=2)]],
        Field(max_length=MOST_TIPS),
    ]
    depth: Annotated[float, Field(ge=DEPTH_MM[0], le=DEPTH_MM[1])]
    radius: Annotated[float, Field(ge=RADIUS_MM[0], le=RADIUS_MM[1])]
    light: Annotated[float, Field(ge=LIGHT[0], le=LIGHT[1])] = 1.0
    shift: Annotated[float, Field(ge=SHIFT_PX[0], le=SHIFT_PX[1])] = 0.0
    instance: Annotated[int, Field(ge=0, le=LAST_INSTANCE)] = 0

    @classmethod
    def read(cls, body: bytes) -> PressRequest:
        """Return the request of a JSON text.

        Raises:
            UserError: The text is no valid request; the message names its first mistake.
        """
        try:
            return cls.model_validate_json(body)
        except ValidationError as error:
            raise UserError(f"the press is not understood: {first_mistake(error, cls)}") from None


@dataclass(frozen=True)
class Subject:
    """A model on the page.

    Attributes:
        label: Name of the model on the page.
        model: Trained model.
        encoder: Encoder that draws a map of the model's contacts; None: the model has its own maps,
            or none are shown.
    """

    label: str
    model: Model
    encoder: Encoder | None = None

    def answer(self, frame: Frame, grid: Grid) -> AnswerView:
        """Return the model's answer to a frame.

        Raises:
            UserError: The model fails.
        """
        began = time.perf_counter()
        try:
            prediction, maps = call_plugin(lambda: ask(self.model, frame))
        except PluginError as error:
            raise UserError(f"model {self.label} failed on this frame: {error}.") from error
        ms = 1e3 * (time.perf_counter() - began)
        if maps is None and self.encoder is not None and isinstance(prediction, Contacts):
            drawn: Maps = self.encoder.encode(prediction, grid)
            return AnswerView(prediction, ms, drawn, drawn=True)
        return AnswerView(prediction, ms, maps)


@dataclass(frozen=True)
class _OpenSensor:
    sensor: Sensor
    pins: PinLines


class PressSession:
    """A simulated sensor that is pressed by hand.

    It answers from several threads, one press at a time.
    """

    def __init__(
        self,
        make_sensor: Callable[[int], Sensor],
        subjects: Sequence[Subject],
        grid: Grid,
        *,
        dome_radius_mm: float,
        gate_mm: float,
    ) -> None:
        """Open the nominal sensor and let every model answer once.

        Args:
            make_sensor: Makes a sensor instance by its number.
            subjects: One or more models.
            grid: Cells of maps and skin.
            dome_radius_mm: Radius of the sensor's dome.
            gate_mm: Distance in the plane from which a contact is missed.

        Raises:
            UserError: The sensor cannot be pressed, or a model fails.
        """
        self._make, self._subjects, self._grid = make_sensor, subjects, grid
        self._dome_radius, self._gate = dome_radius_mm, gate_mm
        self._lock = threading.Lock()
        self._number = 0
        self._sensor = lru_cache(OPEN_SENSORS)(self._open)
        # The first press compiles and loads, so that no press of the page waits for that.
        self.press(PressRequest(tips=[[0.0, 0.0]], depth=1.0, radius=3.0))

    def press(self, request: PressRequest) -> bytes:
        """Return what the page shows of a press.

        Raises:
            UserError: The tips are too far from the middle, the sensor refuses the press, or a
                model fails.
        """
        with self._lock:
            view = self._view(request)
            self._number += 1
            return view.message(self._number)

    def _open(self, instance: int) -> _OpenSensor:
        sensor = self._make(instance)
        return _OpenSensor(sensor, PinLines(gray(sensor.rest().image)))

    def _view(self, request: PressRequest) -> FrameView:
        used = self._sensor(request.instance)
        truth, skin = Contacts.none(), None
        if request.tips:
            xy = np.array(request.tips)
            depth = np.full(len(xy), request.depth)
            try:
                scene = scene_of_contacts(xy, depth, request.radius, self._dome_radius)
            except ValueError as error:
                raise UserError(f"{error}; press nearer to the middle.") from None
            truth = true_contacts(scene, self._dome_radius)
            frame = used.sensor.press(scene)
            skin = used.sensor.surface(scene, self._grid)
        else:
            frame = used.sensor.rest()
        image = move(scale(frame.image, request.light), request.shift, 0.0)
        frame = Frame(image, frame.timestamp, frame.pose, frame.rest)
        answers = [subject.answer(frame, self._grid) for subject in self._subjects]
        shown = gray(image)
        return FrameView(shown, used.pins(shown), answers, truth, self._gate, skin)
