"""Sensors whose frames are rendered: what they share, whatever moves their markers."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Self

import numpy as np
import numpy.typing as npt

from tactibench import Frame, Pose, Scene, Sensor, SensorContext, UserError
from tactibench_sim.ahead import cores, in_order
from tactibench_sim.noise import streams
from tactibench_sim.render import Renderer

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]
BATCH = 64
FRAMES_PER_SECOND = 30.0
"""Nominal rate behind the timestamps; a simulated sensor has no clock."""


@dataclass(frozen=True, eq=False)
class _Batch:
    """Presses number ``first`` and on; error: what is wrong with the scene after them."""

    first: int
    scenes: Sequence[Scene]
    images: Sequence[Images]
    error: UserError | None = None


class RenderedSensor(Sensor):
    """A sensor that knows where its markers are.

    A subclass says in ``points`` where. Frames depend on the scene, the parameters and, for their
    noise, on the seed and the number of presses since the sensor was opened; not on how presses are
    grouped or on how many threads make them.
    """

    def __init__(
        self, context: SensorContext, renderer: Renderer, resting: Array, threads: int | None = None
    ) -> None:
        """resting: (P, 3) the untouched markers. threads: of ``press_many``; None: ``cores()``."""
        self.renderer = renderer
        self.threads = threads or cores()
        self._seed = context.seed
        self._rest = renderer.frames(resting[None])[0]
        self._rest.setflags(write=False)
        self._count = 0

    @abstractmethod
    def points(self, scenes: Sequence[Scene]) -> Array:
        """(S, P, 3) mm, every marker of every scene, as ``Renderer`` takes them.

        Raises UserError for a scene that cannot be pressed.
        """

    def __enter__(self) -> Self:
        self._count = 0
        return self

    def rest(self) -> Frame:
        """The undeformed sensor, without noise."""
        return Frame(self._rest, self._count / FRAMES_PER_SECOND, Pose(), self._rest)

    def press(self, scene: Scene) -> Frame:
        """Press once. Raises UserError for a scene that cannot be pressed."""
        return self._frame(scene, self._images([scene], self._count)[0])

    def press_many(self, scenes: Iterable[Scene]) -> Iterator[Frame]:
        """Press in order. Batches are made ahead on threads; a press counts when it is taken.

        Raises UserError for a scene that cannot be pressed, after the frames before it.
        """
        for batch in in_order(self._make, self._numbered(scenes), self.threads):
            for k, (scene, image) in enumerate(zip(batch.scenes, batch.images, strict=True)):
                if self._count == batch.first + k:
                    yield self._frame(scene, image)
                else:  # somebody pressed in between: its noise is that of another press
                    yield self.press(scene)
            if batch.error is not None:
                raise batch.error

    def _numbered(self, scenes: Iterable[Scene]) -> Iterator[tuple[int, list[Scene]]]:
        source, first = iter(scenes), self._count
        while batch := list(islice(source, BATCH)):
            yield first, batch
            first += len(batch)

    def _make(self, numbered: tuple[int, list[Scene]]) -> _Batch:
        first, scenes = numbered
        try:
            return _Batch(first, scenes, list(self._images(scenes, first)))
        except UserError:
            images: list[Images] = []
            for k, scene in enumerate(scenes):
                try:
                    images.append(self._images([scene], first + k)[0])
                except UserError as error:
                    return _Batch(first, scenes[:k], images, error)
            raise

    def _images(self, scenes: Sequence[Scene], first: int) -> Images:
        states = streams(self._seed, first, len(scenes))
        return self.renderer.frames(self.points(scenes), states)

    def _frame(self, scene: Scene, image: Images) -> Frame:
        """The next press. A copy: a kept frame shall not keep its whole batch."""
        self._count += 1
        return Frame(image.copy(), self._count / FRAMES_PER_SECOND, scene.pose, self._rest)
