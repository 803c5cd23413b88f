"""What stands behind a spec: the classes a plugin writes, as typing protocols.

Nothing has to inherit from these; a class with the methods is enough.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Answer, Contacts, FloatArray, Frame, Grid, Scene

Maps = npt.NDArray[np.float32]


class Encoder(Protocol):
    """Contacts <-> maps, in millimetres; nothing is rounded to a cell when encoding.

    channels: number of maps. separation: closest spacing told apart, mm. tolerance: largest
    round-trip error in x, y and depth of one contact away from the border, mm.
    A target is called as ``Class(**parameters)``.
    """

    channels: int
    separation: float
    tolerance: float

    def encode(self, contacts: Contacts, grid: Grid) -> Maps:
        """Return (C, H, W) float32 maps in 0..1."""
        ...

    def decode(self, maps: Maps, grid: Grid) -> Contacts:
        """Read contacts from (C, H, W) maps, best first."""
        ...

    def decode_batch(self, maps: Maps, grid: Grid) -> list[Contacts]:
        """Read contacts from (N, C, H, W) maps."""
        ...


@dataclass(frozen=True)
class ModelContext:
    """What the benchmark tells a model when it builds it: ``Class(context, **parameters)``.

    answer: "contacts" or "plate", what ``predict`` must return. grid: of the heatmaps.
    max_depth: mm, heatmap value 1. encoder: None for models that do not use one.
    device: "cpu" or "cuda". checkpoints: folder in which ``fit`` keeps what it needs to resume;
    None: nothing is kept. transfers: whether frames of another sensor will be shown than ``fit``
    is given; each carries its own sensor's rest image.
    """

    answer: str
    grid: Grid
    max_depth: float
    encoder: Encoder | None = None
    device: str = "cpu"
    checkpoints: Path | None = None
    transfers: bool = False


class Progress(Protocol):
    """Told by ``fit`` after each step and epoch; the command line draws it."""

    def start(self, epochs: int, steps: int) -> None:
        """Training begins: at most ``epochs`` epochs of ``steps`` steps."""
        ...

    def step(self, loss: float) -> None:
        """One optimiser step was taken."""
        ...

    def epoch(self, epoch: int, loss: float, validation_mm: float | None) -> None:
        """One epoch ended. epoch counts from 1; validation_mm: mean position error, mm."""
        ...


@dataclass(frozen=True)
class FitReport:
    """How training went. history: one dict per epoch. seconds: spent in this and earlier calls."""

    epochs: int = 0
    seconds: float = 0.0
    resumed_from: int = 0
    history: tuple[dict[str, float], ...] = ()
    notes: dict[str, Any] = field(default_factory=dict)


class Model(Protocol):
    """Frames -> contacts (or plate poses)."""

    def fit(
        self,
        frames: Sequence[Frame],
        truth: Sequence[Answer],
        *,
        validation: tuple[Sequence[Frame], Sequence[Answer]],
        rng: np.random.Generator,
        progress: Progress,
    ) -> FitReport:
        """Learn from labelled frames. Must give the same weights for the same rng state."""
        ...

    def predict(self, frames: Sequence[Frame]) -> Sequence[Answer | None]:
        """Answer every frame in float32 arithmetic; None: no plate pose could be read."""
        ...

    def save(self, directory: Path) -> None:
        """Write the weights into an existing, empty folder."""
        ...

    def load(self, directory: Path) -> None:
        """Read what ``save`` wrote. No pickle of untrusted data."""
        ...


@runtime_checkable
class MapsModel(Protocol):
    """Optional: a model that can show the maps behind its contacts.

    ``read_maps(maps(frames))`` must be ``predict(frames)``: a run then asks for the maps of every
    frame and reads them, so that the network runs once.
    """

    def maps(self, frames: Sequence[Frame]) -> Maps:
        """Return (N, C, H, W) float32 maps in 0..1."""
        ...

    def read_maps(self, maps: Maps) -> Sequence[Answer | None]:
        """Return the answers that (N, C, H, W) maps stand for."""
        ...


@runtime_checkable
class Adapts(Protocol):
    """Optional: a model that a few labelled frames of another sensor bring over to that sensor.

    Models without it are scored as they were trained, without such frames.
    """

    def adapt(self, frames: Sequence[Frame], truth: Sequence[Answer]) -> Mapping[str, Any]:
        """Take labelled frames of the sensor that ``predict`` will be shown.

        Starts from what ``fit`` or ``load`` left, so that nothing stays of an earlier call; no
        frames: ``predict`` answers as it was trained. Draws nothing at random. Returns what was
        chosen, as JSON values for the record.
        """
        ...


@runtime_checkable
class StagedModel(Protocol):
    """Optional: a model whose phases can be timed apart.

    stages: name -> callable, applied in order to a list of frames; their composition is
    ``predict`` in the fast configuration (which may use lower precision than ``predict``).
    An attribute ``timed_as`` may name that configuration, such as "bf16, channels_last".
    """

    def stages(self) -> Sequence[tuple[str, Any]]: ...


@runtime_checkable
class ConfiguredModel(Protocol):
    """Optional: a model that can compute its answers in several ways, timed against each other.

    configurations: name -> what it is, in words, such as "float32, channels_last".
    configured: the stages of one of them, as of ``StagedModel``, made ready for lists of any length
    of frames like the given ones. Raises UserError with the reason where this machine cannot.
    """

    @property
    def configurations(self) -> Mapping[str, str]: ...

    def configured(self, name: str, frames: Sequence[Frame]) -> Sequence[tuple[str, Any]]: ...


@runtime_checkable
class KnowsCost(Protocol):
    """Optional: a model that knows how large it is and how much it computes.

    parameters: number of trained weights. flops: floating-point operations of a forward pass of one
    frame, a product and a sum counted as two; None where they cannot be counted.
    """

    @property
    def parameters(self) -> int: ...

    def flops(self, frame: Frame) -> int | None: ...


@runtime_checkable
class ShowsFeatures(Protocol):
    """Optional: a model that can show what its layers make of a frame; a run draws it."""

    def features(self, frame: Frame) -> Mapping[str, npt.NDArray[Any]]:
        """Layer -> (C, H, W) finite activations, in the order of the forward pass."""
        ...


@dataclass(frozen=True)
class SensorContext:
    """What the benchmark tells a sensor: ``Class(context, **parameters)``.

    seed: of everything random in the frames. data: folder given with ``--data``, or None.
    indentation: whether depths must mean the same on every sensor, so that a label's own zero and
    pivot have to be known.
    """

    seed: np.random.SeedSequence
    data: Path | None = None
    indentation: bool = False


class Sensor(Protocol):
    """Scenes -> frames. A context manager: devices are opened on entry and closed on exit."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...

    def rest(self) -> Frame:
        """The undeformed sensor."""
        ...

    def press(self, scene: Scene) -> Frame:
        """Press once. Raises UserError for a scene it cannot press."""
        ...

    def press_many(self, scenes: Iterable[Scene]) -> Iterator[Frame]:
        """Press in order; a faster sensor may work ahead."""
        ...

    def describe(self) -> dict[str, Any]:
        """Everything that determines the frames, as JSON values: geometry, tables, noise."""
        ...


@runtime_checkable
class HasScenes(Protocol):
    """Optional: a sensor that can press only the scenes it has (recorded folders)."""

    def scenes(self) -> dict[str, Scene]:
        """Frame name -> scene."""
        ...


@runtime_checkable
class HasPresses(Protocol):
    """Optional: a sensor with scenes of which several belong to one press that was pushed on.

    Their frames are not independent: intervals take a press as one."""

    def presses(self) -> dict[str, str]:
        """Frame name -> name of its press."""
        ...


@runtime_checkable
class HasParts(Protocol):
    """Optional: a sensor with scenes that were divided by who recorded them."""

    def parts(self) -> Mapping[str, str]:
        """Frame name -> "train", "validation" or "test"; a frame that is in none is not used. {}:
        the protocol divides."""
        ...


@runtime_checkable
class Calibrated(Protocol):
    """Optional: a simulated sensor with numbers that were fitted to recorded frames."""

    def calibrated_on(self) -> Mapping[str, Sequence[str]]:
        """sha256 of a recording -> names of its frames that were used: they test nothing."""
        ...


@runtime_checkable
class KnowsSurface(Protocol):
    """Optional: a sensor that knows how far its skin really moved (simulators)."""

    def surface(self, scene: Scene, grid: Grid) -> FloatArray:
        """(H, W) true inward displacement of the skin along the dome's normal, mm.

        Cell (i, j) is the point of the undeformed dome above the cell's centre."""
        ...


@runtime_checkable
class KnowsBound(Protocol):
    """Optional: a sensor that knows the Cramer-Rao bound of its frames (simulators)."""

    def bound(self, scene: Scene) -> FloatArray:
        """(K, 3) smallest possible standard deviation of x, y and depth of every contact, mm.

        Rows in the order of ``true_contacts``; inf where the frame says nothing."""
        ...


@runtime_checkable
class KnowsCovariance(KnowsBound, Protocol):
    """Optional: one that knows how the bounds hang together, and what unknown optics add to them.

    nuisances: names of what may be unknown of the camera, such as "brightness". ``bound`` is the
    root of the covariance's diagonal without any of them.
    """

    nuisances: tuple[str, ...]

    def covariance(self, scene: Scene, nuisances: Sequence[str] = ()) -> FloatArray:
        """(3 K, 3 K) smallest possible covariance of x, y and depth of every contact, mm^2.

        Contacts in the order of ``true_contacts``, x, y, depth of the first in front. Of a
        parameter about which the frame says nothing the variance is inf, the covariances are 0.
        Raises UserError for a scene it cannot press or a nuisance it does not know."""
        ...


@runtime_checkable
class KeepsAccount(Protocol):
    """Optional: a sensor that makes scenes in more than one way and says how many in which.

    What it says goes into the record; an empty dict: there is nothing to say."""

    def account(self, scenes: Sequence[Scene]) -> dict[str, int]: ...
