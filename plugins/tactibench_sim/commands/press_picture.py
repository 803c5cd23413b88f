"""The picture of one press: the frame, its markers' displacement, the dimple in the skin."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from scipy.ndimage import map_coordinates

from tactibench import Grid, Pose, Scene, UserError
from tactibench.geometry import DOME_RADIUS_MM
from tactibench.lab import atomic
from tactibench_sim.rendered_sensor import RenderedSensor
from tactibench_sim.sensor import SimulatedTacTip

Array = npt.NDArray[np.float64]


COLOURS = "cividis"
REST = "#56B4E9"
"""Sky blue of Okabe and Ito (2008): visible on black and on white, also to colour-blind readers."""
SHOWN_MM = 13.0
"""Radius of the piece of skin that is drawn."""
SEEN_FROM_DEG = 46.0
"""Elevation of the view, above the steepest slope of that piece, 40 deg."""
LINES = 8
EXAGGERATIONS = (1, 2, 5, 10, 20, 50, 100)


def draw(path: Path, sensor: RenderedSensor, scene: Scene, title: str, detail: str) -> None:
    """Write a PNG of three panels.

    Args:
        path: File to write.
        sensor: The sensor.
        scene: The press.
        title: Text at the top left.
        detail: Text at the top right.

    Raises:
        UserError: The sensor cannot press the scene or does not know its skin.
    """
    frame = sensor.press(scene).image
    before = marker_pixels(sensor, Scene(scene.indenter, Pose()))
    after = marker_pixels(sensor, scene)
    figure = Figure(figsize=(12.2, 4.0), dpi=200)
    FigureCanvasAgg(figure)
    window = _window(len(frame), before, after)
    _frame(figure.add_axes((0.042, 0.12, 0.238, 0.72)), frame, before, window)
    _arrows(
        figure.add_axes((0.328, 0.12, 0.238, 0.72)),
        figure.add_axes((0.572, 0.12, 0.008, 0.72)),
        before,
        after,
        window,
    )
    _skin(
        figure.add_axes((0.625, -0.06, 0.305, 1.02), projection="3d"),
        figure.add_axes((0.945, 0.18, 0.008, 0.56)),
        sensor,
        scene,
    )
    figure.text(0.635, 0.858, "c", fontsize=11, fontweight="bold", va="baseline")
    figure.text(0.649, 0.858, "skin, true to scale", fontsize=10, va="baseline")
    figure.text(0.008, 0.975, title, fontsize=11, va="top", fontweight="bold")
    figure.text(0.992, 0.975, detail, fontsize=9, va="top", ha="right", color="#404040")
    with atomic(path) as stream:
        figure.savefig(stream, format="png", metadata={"Software": None})


def _window(size: int, *markers: Array) -> tuple[float, float]:
    """Return first and last pixel of the centred square that holds all markers."""
    middle = (size - 1) / 2
    reach = max(float((np.abs(m[:, :2] - middle) + m[:, 2:]).max()) for m in markers)
    half = min(1.08 * reach, size / 2)
    return middle - half, middle + half


def marker_pixels(sensor: RenderedSensor, scene: Scene) -> Array:
    """Return (P, 3) pixel x, y and radius of every marker, px."""
    out: Array = np.stack(sensor.renderer.project(sensor.points([scene])), axis=-1)[0]
    return out


def _frame(
    axes: Any, image: npt.NDArray[np.uint8], before: Array, window: tuple[float, float]
) -> None:
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    rings = [Circle((x, y), radius) for x, y, radius in before]
    axes.add_collection(
        PatchCollection(rings, facecolor="none", edgecolor=REST, linewidth=0.6, alpha=0.8)
    )
    _pixels(axes, window)
    _heading(axes, "a", "frame; rings: markers at rest")


def _arrows(axes: Any, bar: Any, before: Array, after: Array, window: tuple[float, float]) -> None:
    moved = after[:, :2] - before[:, :2]
    length = np.hypot(*moved.T)
    times = exaggeration(float(length.max()), _spacing(before[:, :2]))
    axes.scatter(*before[:, :2].T, s=5, color="#A0A0A0", linewidth=0, zorder=1)
    order = np.argsort(length)  # the longest on top
    drawn = axes.quiver(
        *before[order, :2].T,
        *(moved[order] * times).T,
        length[order],
        cmap=COLOURS,
        angles="xy",
        scale_units="xy",
        scale=1,
        width=0.008,
        headwidth=3.4,
        headlength=4.0,
        headaxislength=3.6,
        minlength=0.5,
        minshaft=1.2,
        norm=Normalize(0, max(float(length.max()), 1e-9)),
        zorder=2,
    )
    axes.set_aspect("equal")
    _pixels(axes, window)
    _heading(axes, "b", "displacement of the markers" + (f", drawn x {times}" if times > 1 else ""))
    _bar(axes.figure, drawn, bar, "displacement, px")


def exaggeration(longest: float, spacing: float) -> int:
    """Return the largest of 1, 2, 5, ... with which no arrow exceeds 1.6 pin spacings.

    Args:
        longest: Length of the longest arrow, px.
        spacing: Distance of neighbouring pins, px.
    """
    fitting = [k for k in EXAGGERATIONS if k * longest <= 1.6 * spacing]
    return max(fitting, default=1)


def _spacing(points: Array) -> float:
    """Return the median distance of a pin to its nearest neighbour."""
    gaps = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    np.fill_diagonal(gaps, np.inf)
    return float(np.median(gaps.min(axis=1)))


def _skin(axes: Any, bar: Any, sensor: RenderedSensor, scene: Scene) -> None:
    """Draw the cap of the dome, moved along its normal, true to scale; the colour says how far."""
    x, y, z, inward = skin_cap(sensor, scene)
    scale = Normalize(min(float(inward.min()), 0.0), max(float(inward.max()), 1e-6))
    colours = ScalarMappable(scale, COLOURS)
    faces = colours.to_rgba(inward)
    faces[..., :3] *= _daylight(x, y, z)[..., None]
    axes.computed_zorder = False  # lines on the surface, which would hide them
    axes.plot_surface(
        x,
        y,
        z,
        facecolors=faces,
        shade=False,
        rstride=1,
        cstride=1,
        linewidth=0,
        antialiased=False,
        zorder=1,
    )
    lines = {"color": "white", "linewidth": 0.4, "alpha": 0.5, "zorder": 2}
    ring = x.shape[1] // LINES
    for k in range(ring, x.shape[1], ring):  # rings of the undeformed skin
        axes.plot(x[:, k], y[:, k], z[:, k], **lines)
    for k in range(0, x.shape[0] - 1, x.shape[0] // (3 * LINES)):  # and its meridians
        axes.plot(x[k, ring:], y[k, ring:], z[k, ring:], **lines)
    bottom = float(np.floor(z.min()))
    axes.set(
        xlim=(-SHOWN_MM, SHOWN_MM),
        ylim=(-SHOWN_MM, SHOWN_MM),
        zlim=(bottom, 0.5),
        xticks=[-10, 0, 10],
        yticks=[-10, 0, 10],
        zticks=[],
    )
    axes.invert_yaxis()  # y grows towards the viewer, as it grows downwards in the frame
    axes.set_box_aspect((1, 1, (0.5 - bottom) / (2 * SHOWN_MM)), zoom=1.12)
    axes.view_init(elev=SEEN_FROM_DEG, azim=-72)
    axes.tick_params(labelsize=8, pad=-2)
    axes.grid(False)
    for axis, name in ((axes.xaxis, "x, mm"), (axes.yaxis, "y, mm"), (axes.zaxis, "")):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.set_label_text(name, fontsize=9)
        axis.labelpad = -4
    axes.zaxis.line.set_visible(False)
    axes.patch.set_visible(False)
    _bar(axes.figure, colours, bar, "inward displacement, mm")


def _daylight(x: Array, y: Array, z: Array) -> Array:
    """Return the brightness 0.3..1 of a surface in slanting light (Lambert's cosine law)."""
    points = np.stack([x, y, z], axis=-1)
    along, around = np.gradient(points, axis=1), np.gradient(points, axis=0)
    normal = np.cross(along, around)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    normal[:, 0] = normal[:, 1]  # a mesh's middle has no normal
    light = np.array([-0.62, 0.25, 0.74])
    out: Array = 0.3 + 0.7 * np.clip(normal @ light, 0.0, 1.0)
    return out


def skin_cap(
    sensor: RenderedSensor, scene: Scene, rings: int = 56, sectors: int = 144
) -> tuple[Array, Array, Array, Array]:
    """Return x, y, z mm of the outer skin on a polar mesh and its inward displacement, mm.

    z = 0 at the undeformed apex. Tangential motion is left out, as in ``surface``. The skin of
    a sensor that is no dome is flat.

    Args:
        sensor: The sensor.
        scene: The press.
        rings: Steps of the mesh in the radius.
        sectors: Steps of the mesh in the azimuth.

    Raises:
        UserError: The sensor does not know its skin or cannot press the scene.
    """
    grid = Grid.centred(2 * rings + 5, SHOWN_MM / rings)
    radius, turn = np.meshgrid(
        np.linspace(0, SHOWN_MM, rings + 1), np.linspace(0, 2 * np.pi, sectors + 1)
    )
    at = radius[..., None] * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    cells = grid.cells(at)
    surface = sensor.surface(scene, grid)
    if surface is None:
        raise UserError("the sensor does not know its skin, which the picture shows; use another.")
    inward = map_coordinates(surface, cells, order=3, mode="nearest")
    if not isinstance(sensor, SimulatedTacTip):
        return at[..., 0], at[..., 1], -inward, inward
    height = np.sqrt(DOME_RADIUS_MM**2 - radius**2)
    share = 1 - inward / DOME_RADIUS_MM
    return at[..., 0] * share, at[..., 1] * share, height * share - DOME_RADIUS_MM, inward


def _pixels(axes: Any, window: tuple[float, float]) -> None:
    axes.set(xlim=window, ylim=window[::-1])
    axes.set_xlabel("column, px", fontsize=9)
    axes.set_ylabel("row, px", fontsize=9, labelpad=1)
    axes.tick_params(labelsize=8)


def _heading(axes: Any, letter: str, text: str) -> None:
    axes.set_title(letter, fontsize=11, fontweight="bold", loc="left", x=0.0)
    axes.text(0.06, 1.0, text, transform=axes.title.get_transform(), fontsize=10, va="baseline")


def _bar(figure: Any, drawn: Any, axes: Any, label: str) -> None:
    bar = figure.colorbar(drawn, cax=axes)
    bar.set_label(label, fontsize=9)
    bar.ax.tick_params(labelsize=8)
