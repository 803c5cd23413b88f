"""The base of the simulated sensors, and threads that make batches of frames in advance."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import Any, Self, TypeVar

import numpy as np
import numpy.typing as npt

from tactibench import Frame, Pose, Scene, Sensor, SensorContext, UserError
from tactibench_sim.camera import NUISANCES
from tactibench_sim.contact import Tips, tips_of
from tactibench_sim.hooks import tactibench_sensors
from tactibench_sim.renderer import Renderer, streams

Array = npt.NDArray[np.float64]
Images = npt.NDArray[np.uint8]
Item = TypeVar("Item")
Result = TypeVar("Result")
BATCH = 64
"""Presses that one thread makes at a time."""
FRAMES_PER_SECOND = 30.0
"""Nominal rate behind the timestamps; a simulated sensor has no clock."""


class SimulatedSensor(Sensor):
    """A sensor whose frames are rendered from its markers, whose places a subclass computes.

    Frames depend on the scene, the parameters and, for their noise, on the seed and the number of
    presses since the sensor was opened. They do not depend on how presses are grouped or on how
    many threads make them.

    Where the contacts are tips and the places of the markers are smooth in where and how deep they
    are, the sensor knows how well its frames tell contacts; other sensors have no ``nuisances``.

    Attributes:
        threads: Number of threads of ``press_many``.
    """

    nuisances: tuple[str, ...] = NUISANCES

    def __new__(cls, *_: object, **parameters: Any) -> Self:
        """Check the parameters by what the plugin declares, as the command line does.

        Raises:
            UserError: A parameter is unknown, or a value is not allowed.
        """
        declared = {spec.target: spec for spec in tactibench_sensors()}
        for base in cls.__mro__:
            spec = declared.get(f"{base.__module__}:{base.__name__}")
            if spec is not None:
                spec.check(parameters)
                break
        return super().__new__(cls)

    def __init__(self, context: SensorContext, renderer: Renderer, resting: Array) -> None:
        """Render the rest frame.

        Args:
            context: The seed of the noise.
            renderer: The camera.
            resting: (P, 3) places of the untouched markers, mm.
        """
        self.renderer = renderer
        self.threads = thread_count()
        self._seed = context.seed
        self._rest: Images = renderer.frames(resting[None])[0]
        self._rest.setflags(write=False)
        self._count = 0

    def __enter__(self) -> Self:
        """Start again with the first press."""
        self._count = 0
        return self

    def rest(self) -> Frame:
        """Return the frame of the undeformed sensor, without noise."""
        return Frame(self._rest, self._count / FRAMES_PER_SECOND, Pose(), self._rest)

    def press(self, scene: Scene) -> Frame:
        """Press once.

        Raises:
            UserError: The scene cannot be pressed.
        """
        return self._frame(scene, self._images([scene], self._count)[0])

    def press_many(self, scenes: Iterable[Scene]) -> Iterator[Frame]:
        """Press in order. Batches are made in advance on threads.

        A press counts when its frame is taken.

        Raises:
            UserError: A scene cannot be pressed. The frames before it are yielded first.
        """
        for first, batch, images in prefetch(self._make, self._batches(scenes), self.threads):
            for k, scene in enumerate(batch):
                if images is not None and self._count == first + k:
                    yield self._frame(scene, images[k])
                else:  # a scene of the batch is refused, or the caller pressed in between
                    yield self.press(scene)

    def _batches(self, scenes: Iterable[Scene]) -> Iterator[tuple[int, list[Scene]]]:
        source, first = iter(scenes), self._count
        while batch := list(islice(source, BATCH)):
            yield first, batch
            first += len(batch)

    def _make(self, numbered: tuple[int, list[Scene]]) -> tuple[int, list[Scene], Images | None]:
        first, scenes = numbered
        try:
            return first, scenes, self._images(scenes, first)
        except UserError:
            return first, scenes, None

    def _images(self, scenes: Sequence[Scene], first: int) -> Images:
        states = streams(self._seed, first, len(scenes))
        return self.renderer.frames(self.points(scenes), states)

    def _frame(self, scene: Scene, image: Images) -> Frame:
        """Count the next press and return its frame.

        The image is copied, so that its whole batch does not stay in memory.
        """
        rest, force = self._rest_of(self._count), self._force_of(scene, self._count)
        self._count += 1
        return Frame(image.copy(), self._count / FRAMES_PER_SECOND, scene.pose, rest, force)

    def _rest_of(self, number: int) -> Images:  # noqa: ARG002 - one sensor has one rest frame
        """Return the rest image of the sensor instance on which press ``number`` is made."""
        return self._rest

    def _force_of(self, scene: Scene, number: int) -> Array | None:  # noqa: ARG002 - not known
        """Return the (K, 3) forces of the true contacts of press ``number``, N."""
        return None

    def indenter_tips(self, scenes: Sequence[Scene]) -> Tips:
        """Return the tips of scenes, of a sensor with a dome.

        Raises:
            UserError: A scene cannot be pressed.
        """
        return tips_of(scenes)

    def places(self, tips: Tips) -> Array:
        """Return the (S, P, 3) places of the markers under tips, mm, as ``Renderer`` takes them.

        Raises:
            UserError: A scene cannot be pressed.
        """
        raise NotImplementedError  # a sensor without nuisances may define ``points`` alone

    def points(self, scenes: Sequence[Scene]) -> Array:
        """Return the (S, P, 3) places of the markers in S scenes, mm, as ``Renderer`` takes them.

        Raises:
            UserError: A scene cannot be pressed.
        """
        return self.places(self.indenter_tips(scenes))

    def clean(self, tips: Tips) -> Array:
        """Return (S, size, size) grey levels without noise.

        Raises:
            UserError: A scene cannot be pressed.
        """
        return self.renderer.clean(self.places(tips))

    def covariance(self, scene: Scene, nuisances: Sequence[str] = ()) -> Array | None:
        """Return the (3 K, 3 K) mm^2 Cramer-Rao covariance of x, y, depth of every true contact.

        It is that of the grey frame that models see. It holds for output "bw", too, but cannot be
        reached there.

        Args:
            scene: The press.
            nuisances: Unknown properties of the camera, names of ``NUISANCES``.
        """
        if not self.nuisances:
            return None
        from tactibench_sim.bounds import covariance  # few protocols ask for bounds

        tips = self.indenter_tips([scene])
        return covariance(tips, self.clean, self.renderer.variance, nuisances)

    def bound(self, scene: Scene) -> Array | None:
        """Return (K, 3) Cramer-Rao standard deviations of x, y, depth of every contact, mm."""
        covariance = self.covariance(scene)
        if covariance is None:
            return None
        out: Array = np.sqrt(np.diag(covariance)).reshape(-1, 3)
        return out

    def deviance(self, scene: Scene, nuisances: Sequence[str] = ()) -> float | None:
        """Return the squared d' of the scene's two contacts against the nearest single one.

        ``nuisances`` are those of ``covariance``.
        """
        if not self.nuisances:
            return None
        from tactibench_sim.bounds import deviance  # few protocols ask for limits

        tips = self.indenter_tips([scene])
        return deviance(tips, self.clean, self.renderer.variance, nuisances)


def thread_count() -> int:
    """Return how many threads this process may use: OMP_NUM_THREADS, or else its processors."""
    limit = os.environ.get("OMP_NUM_THREADS", "")
    if limit.isdecimal() and int(limit) > 0:
        return int(limit)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def prefetch(
    work: Callable[[Item], Result], items: Iterable[Item], threads: int
) -> Iterator[Result]:
    """Yield ``map(work, items)``, computed on threads at most threads + 1 items in advance.

    With one thread nothing is computed before it is needed. When the consumer stops, items that
    have not begun are dropped, and the function waits for those that have.

    Raises:
        Exception: Whatever ``work`` or ``items`` raises.
    """
    if threads == 1:
        yield from map(work, items)
        return
    source = iter(items)
    waiting: deque[Future[Result]] = deque()
    pool = ThreadPoolExecutor(threads, thread_name_prefix="tactibench-sim")
    try:
        while True:
            for item in islice(source, threads + 1 - len(waiting)):
                waiting.append(pool.submit(work, item))
            if not waiting:
                return
            yield waiting.popleft().result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
