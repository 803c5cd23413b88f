"""Base classes of what a plugin writes: models, sensors and encoders.

A plugin's class inherits from `Model`, `Sensor` or `Encoder`, all exported from ``tactibench``.
The abstract methods must be written. Every other method has a default that says "not known" or
"not needed" (None, an empty mapping, one call after the other), so that no caller has to ask what a
class can do; a plugin writes those that it can answer better.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType, TracebackType
from typing import Any, ClassVar, Literal, Protocol, Self

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, FloatArray, Frame, Grid, Scene, Workspace
from tactibench.errors import UserError
from tactibench.plugins.specs import IMAGE

Maps = npt.NDArray[np.float32]
Stage = tuple[str, Callable[[Any], Any]]
"""Name of a phase of prediction, and the function that computes it."""


Prior = Literal["none", "plain addition", "nominal mechanics", "fitted to multi-contact labels"]
"""Knowledge that a model has, besides its frames, of contacts that press together: none; that their
displacements add up; the mechanics of a nominal sensor; a law that was fitted to labelled presses
with several contacts, those of its own training included."""


@dataclass(frozen=True)
class FitReport:
    """Summary of a training.

    Attributes:
        epochs: Number of epochs, those before an interruption included.
        seconds: Time spent in this and earlier calls.
        resumed_from: Epoch of the checkpoint from which training went on; 0: from the start.
        history: One mapping per epoch.
        notes: JSON values for the record.
        prior: What the model knew of contacts that press together, see ``Prior``; None: not stated.
            Of models that ship the spec says it.
    """

    epochs: int = 0
    seconds: float = 0.0
    resumed_from: int = 0
    history: tuple[dict[str, float], ...] = ()
    notes: dict[str, Any] = field(default_factory=dict)
    prior: Prior | None = None


class Encoder(ABC):
    """Contacts <-> maps, in millimetres; nothing is rounded to a cell when encoding.

    The benchmark builds it as ``Class(**parameters)``.

    Attributes:
        channels: Number of maps.
        separation: Closest spacing of two contacts that are told apart, mm.
        tolerance: Largest round-trip error in x, y and depth of one contact away from the border,
            mm.
        expected_failed_checks: Property of ``tactibench check`` -> reason why it does not hold.
    """

    expected_failed_checks: ClassVar[Mapping[str, str]] = MappingProxyType({})
    channels: int
    separation: float
    tolerance: float

    @abstractmethod
    def encode(self, contacts: Contacts, grid: Grid) -> Maps:
        """Return the (C, H, W) float32 maps, in 0..1, of the contacts of one frame."""

    @abstractmethod
    def decode(self, maps: Maps, grid: Grid) -> Contacts:
        """Return the contacts that (C, H, W) maps show, best first."""

    def encode_batch(self, contacts: Sequence[Contacts], grid: Grid) -> Maps:
        """Return (N, C, H, W) float32 maps, the same as ``encode`` one by one.

        Default: one call of ``encode`` a frame.
        """
        maps = np.empty((len(contacts), self.channels, *grid.shape), dtype=np.float32)
        for row, one_frame in enumerate(contacts):
            maps[row] = self.encode(one_frame, grid)
        return maps

    def decode_batch(self, maps: Maps, grid: Grid) -> list[Contacts]:
        """Return the contacts of every one of (N, C, H, W) maps, the same as ``decode``.

        Default: one call of ``decode`` a frame.
        """
        return [self.decode(one_frame, grid) for one_frame in maps]


@dataclass(frozen=True)
class ModelContext:
    """The circumstances that a model is built for: ``Class(context, **parameters)``.

    Attributes:
        answer: "contacts", "plate" or "sites", what ``predict`` must return.
        grid: Cells of the heatmaps.
        max_depth: Depth that a heatmap value of 1 stands for, mm.
        encoder: None for models that do not use one.
        device: "cpu" or "cuda".
        checkpoints: Folder in which ``fit`` keeps what it needs to resume; None: nothing is kept.
        transfers: Whether ``predict`` will be shown frames of another sensor than ``fit``. Each
            carries its own sensor's rest image.
    """

    answer: str
    grid: Grid
    max_depth: float
    encoder: Encoder | None = None
    device: str = "cpu"
    checkpoints: Path | None = None
    transfers: bool = False


class Progress(Protocol):
    """Listener that ``fit`` tells of each step and epoch; the command line draws it."""

    def start(self, epochs: int, steps: int) -> None:
        """Begin a training of at most ``epochs`` epochs of ``steps`` steps."""
        ...

    def step(self, loss: float) -> None:
        """Count one optimiser step."""
        ...

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        """End an epoch.

        Args:
            epoch: Number of the epoch, counted from 1.
            loss: Loss of the epoch.
            validation_mm: Mean position error on the validation frames, mm; None: not measured.
        """
        ...


class Model(ABC):
    """Frames -> contacts (or plate poses).

    The benchmark builds it as ``Class(context, **parameters)``, see `ModelContext`.

    Attributes:
        expected_failed_checks: Property of ``tactibench check`` -> reason why it does not hold.
    """

    expected_failed_checks: ClassVar[Mapping[str, str]] = MappingProxyType({})

    @abstractmethod
    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Learn from labelled frames.

        Args:
            frames: Frames to learn from.
            truth: The true answer to every frame.
            validation: Frames that are not learned from, and their true answers.
            rng: Source of all randomness; the same state must give the same weights.
            progress: Listener to call at each step and epoch.
        """

    @abstractmethod
    def predict(self, frames: Sequence[Frame]) -> Sequence[Answer | None]:
        """Return one answer a frame; None: no plate pose could be read."""

    @abstractmethod
    def save(self, directory: Path) -> None:
        """Write the weights into an existing, empty folder."""

    @abstractmethod
    def load(self, directory: Path) -> None:
        """Read what ``save`` wrote. No pickle of untrusted data."""

    def maps(self, frames: Sequence[Frame]) -> Maps | None:  # noqa: ARG002
        """Return the (N, C, H, W) float32 maps, in 0..1, behind the contacts.

        A model that has maps writes ``read_maps`` as well: ``read_maps(maps(frames))`` must be
        ``predict(frames)``. A run then asks for the maps and reads them, so that the network runs
        once. Default: None, the model has no maps.
        """
        return None

    def read_maps(self, maps: Maps) -> Sequence[Answer | None]:  # noqa: ARG002
        """Return the answers that (N, C, H, W) maps stand for. Default: not needed without maps."""
        name = type(self).__name__
        raise UserError(f"model {name} gives maps, but has no read_maps; write it beside maps.")

    def adapt(
        self,
        frames: Sequence[Frame],  # noqa: ARG002
        truth: Sequence[Answer],  # noqa: ARG002
    ) -> Mapping[str, Any] | None:
        """Correct the answers by a few labelled frames of the sensor that is tested.

        The frames are single presses where contacts are asked for, however many contacts a test
        frame holds (``--test shots=N``). Start from the state that ``fit`` or ``load`` left, so
        that nothing of an earlier call remains. Without frames, ``predict`` answers as it was
        trained. Draw nothing at random. Return the settings chosen, as JSON values for the record.
        Default: None, the model cannot adapt; it is scored as it was trained.
        """
        return None

    def stages(self) -> Sequence[Stage]:
        """Return the phases of a prediction, to be timed one by one.

        They are applied in order to a list of frames, and together they are ``predict``: what is
        scored is what is timed. Default: ``predict`` as the only phase.
        """
        return [("predict", self.predict)]

    def parameter_count(self) -> int | None:
        """Return the number of trained weights. Default: None, not known."""
        return None

    def flops(self, frame: Frame) -> int | None:  # noqa: ARG002
        """Return the floating-point operations of a forward pass of one frame.

        A product and a sum count as two. Default: None, not known.
        """
        return None


@dataclass(frozen=True)
class SensorContext:
    """The circumstances that a sensor is built for: ``Class(context, **parameters)``.

    Attributes:
        seed: Seed of everything random in the frames.
        data: Folder given with ``--data``, or None.
        indentation: Whether depths must mean the same on every sensor, so that a label's own zero
            and pivot have to be known.
    """

    seed: np.random.SeedSequence
    data: Path | None = None
    indentation: bool = False


class Sensor(ABC):
    """Scenes -> frames. A context manager: devices are opened on entry and closed on exit.

    The benchmark builds it as ``Class(context, **parameters)``, see `SensorContext`.

    Attributes:
        signal: Kind of the frames' signal, "image" (uint8) or "channels" (float32).
        dome_radius_mm: Radius of the touched surface, mm; inf: flat; None: the protocol's dome.
        deepest_mm: Depth to which a tip may be pressed, mm; inf: as deep as the protocol asks.
        workspace: Range in place of the protocols', of a flat, larger or smaller sensor.
        nuisances: Names of what ``covariance`` may take as unknown, such as "brightness".
        expected_failed_checks: Property of ``tactibench check`` -> reason why it does not hold.
    """

    expected_failed_checks: ClassVar[Mapping[str, str]] = MappingProxyType({})
    signal: str = IMAGE
    dome_radius_mm: float | None = None
    deepest_mm: float = math.inf
    workspace: Workspace | None = None
    nuisances: tuple[str, ...] = ()

    def __enter__(self) -> Self:
        """Open the devices. Default: there are none."""
        return self

    def __exit__(  # noqa: B027 - not abstract: many sensors have nothing to close
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the devices, whatever happened. Default: there are none."""

    @abstractmethod
    def rest(self) -> Frame:
        """Return a frame of the undeformed sensor."""

    @abstractmethod
    def press(self, scene: Scene) -> Frame:
        """Press once and return the frame.

        Raises:
            UserError: The scene cannot be pressed.
        """

    @abstractmethod
    def describe(self) -> dict[str, Any]:
        """Return everything that determines the frames, as JSON values: geometry, tables, noise."""

    def press_many(self, scenes: Iterable[Scene]) -> Iterator[Frame]:
        """Press in order; a faster sensor may work ahead. Default: ``press`` one after another."""
        return map(self.press, scenes)

    def frames(self, names: Iterable[str]) -> Iterator[Frame]:
        """Return the frames of ``scenes`` by their names. Default: each scene is pressed."""
        scenes = self.scenes() or {}
        return self.press_many(scenes[name] for name in names)

    def scenes(self) -> Mapping[str, Scene] | None:
        """Return the only scenes that the sensor can press: name of a frame -> scene.

        Recorded folders and reference scenes have such a list. Default: None, it presses any scene.
        """
        return None

    def presses(self) -> Mapping[str, str]:
        """Return the press that each of ``scenes`` belongs to: name of a frame -> name of a press.

        Frames of one press are not independent: intervals count a press once. Default: {}, each
        frame is a press of its own.
        """
        return {}

    def sessions(self) -> Mapping[str, str]:
        """Return the session in which each of ``scenes`` was recorded, by the name of its frame.

        Default: {}, not known.
        """
        return {}

    def split(self) -> Mapping[str, str]:
        """Return how ``scenes`` were divided by who recorded them.

        Name of a frame -> "train", "validation" or "test"; other frames are not used. Default: {},
        the protocol divides.
        """
        return {}

    def calibrated_on(self) -> Mapping[str, Sequence[str]]:
        """Return the recorded frames to which the numbers of a simulated sensor were fitted.

        sha256 of a recording -> names of its frames; they test nothing. Default: {}, none.
        """
        return {}

    def surface(self, scene: Scene, grid: Grid) -> FloatArray | None:  # noqa: ARG002
        """Return the (H, W) true inward displacement of the skin along the dome's normal, mm.

        Cell (i, j) is the point of the undeformed dome above the cell's centre. Default: None, not
        known.
        """
        return None

    def bound(self, scene: Scene) -> FloatArray | None:  # noqa: ARG002
        """Return the (K, 3) smallest standard deviations of x, y, depth of every contact, mm.

        This is the Cramer-Rao bound. Rows are in the order of ``true_contacts``; inf where the
        frame says nothing. Default: None, not known.
        """
        return None

    def covariance(
        self,
        scene: Scene,  # noqa: ARG002
        nuisances: Sequence[str] = (),  # noqa: ARG002
    ) -> FloatArray | None:
        """Return the (3 K, 3 K) smallest covariance of x, y, depth of every contact, mm^2.

        Contacts are in the order of ``true_contacts``; x, y, depth of the first one come first.
        Where the frame says nothing about a parameter, its variance is inf and its covariances are
        0. Without nuisances, ``bound`` is the root of the diagonal. Raise UserError for a scene
        that cannot be pressed or an unknown nuisance. Default: None, not known.
        """
        return None

    def error_bounds(self, scenes: Sequence[Scene]) -> FloatArray | None:  # noqa: ARG002
        """Return (S,) mm, how far a marker of a simulated sensor may be from finite elements.

        The bounds are measured; inf for a scene for which nothing was measured. They should take
        less than a tenth of a millisecond a scene: every run asks for those of its test scenes.
        Default: None, not known.
        """
        return None

    def terms(self, scenes: Sequence[Scene]) -> Mapping[str, int]:  # noqa: ARG002
        """Return the terms of a simulated field and the number of scenes that need each.

        Terms are named in the simulator's own words, such as "pair"; a scene may need several. A
        simulator may also count scenes whose field it finds wrong, such as "depth missed".
        Default: {}, not known.
        """
        return {}

    def deviance(
        self,
        scene: Scene,  # noqa: ARG002
        nuisances: Sequence[str] = (),  # noqa: ARG002
    ) -> float | None:
        """Return how surely the frame of two contacts differs from that of any single contact.

        It is the squared d' of the log likelihood ratio, sum (m2 - m1)^2 / v over pixels, with m2
        the noise-free frame of the scene, m1 that of the single contact nearest to it and v the
        variance of the noise. Raise UserError as ``covariance`` does. Default: None, not known.
        """
        return None
