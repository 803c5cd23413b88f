"""Draw real frames beside simulated ones, and print the sizes of their pins.

    python benchmarks/real_pictures.py DIR/331/model_surface2d DIR/127/model_surface2d --out FILE

For each recording of Tac-VGNN (Apache-2.0; Fan et al., ICRA 2023), the picture shows its rest frame
and two presses to which its calibration was not fitted, beside `fitted-*` of version 2 with the
same indentation and tilt, black and white and with irregular glare. The presses are not picked by
hand: among those that the robot moved by less than 0.5 mm, they are the ones nearest to 3.5 mm
deep, level and tilted by 12 deg.

The table shows the area of the blob of a pin, px, at rest and under presses deeper than 3 mm, by
the polar angle of the pin, over 300 presses that no fit saw; and likewise of version 1. It takes a
minute.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from fit_presets import blob_radii
from matplotlib.figure import Figure
from preset_motion import pairs

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench_sim.real.calibration import calibration
from tactibench_sim.real.comparison import checkerboard
from tactibench_sim.real.plate import directions, indentation
from tactibench_sim.real.recording import REST, Presses, read
from tactibench_sim.real.sensor import Fitted127, Fitted331, FittedSensor

Array = npt.NDArray[np.float64]
Images = list[npt.NDArray[np.uint8]]
SENSORS: dict[int, tuple[type[FittedSensor], dict[str, float]]] = {
    331: (Fitted331, {"glare_width": 0.014, "glare_arc": 80.0, "glare_radius": 0.465}),
    127: (Fitted127, {"glare_radius": 0.475}),
}
"""Number of pins -> sensor, and the glare of the real one where it differs from the default."""
GLARE = {"glare": 1.0, "glare_scatter": 0.6, "glare_seed": 3}
DEPTH_MM, TILTS_DEG, STILL_MM = 3.5, (0.0, 12.0), 0.5
DEEP_MM, COUNT = 3.0, 300
POLARS = (0.0, 12.0, 24.0, 36.0, 48.0, 60.0)


def simulated(presses: Presses, rows: Array, version: int, **optical: Any) -> tuple[Images, Array]:
    """Return the rest frame and the frames of presses, and the (S + 1, P, 2) places of pins, px.

    Args:
        presses: Real presses.
        rows: (S,) rows of the presses to simulate.
        version: Version of the sensor.
        **optical: Optical parameters of the sensor, such as its glare.
    """
    pins = len(presses.rest)
    x = calibration(str(pins)).unknowns
    depth = indentation(x, presses.labels).clip(0.0)
    sensor = SENSORS[pins][0](
        SensorContext(np.random.SeedSequence(0)),
        size=presses.side,
        calibration=str(pins),
        drag=0.0,
        version=version,
        output="bw",
        **optical,
    )
    scenes = [
        Scene(Indenter.plate(), Pose(yaw=90.0, tilt=float(presses.labels.tilt[k]), depth=depth[k]))
        for k in rows
    ]
    moved = np.concatenate([np.zeros((1, pins, 2)), sensor.moved(scenes)])
    frames = [frame.image for frame in sensor.press_many(scenes)]
    return [sensor.rest().image, *frames], sensor.rig.rest + moved


def real(folder: Path, presses: Presses, rows: Array) -> tuple[Images, Array]:
    """Return real frames and places of the pins, as ``simulated`` does.

    Args:
        folder: Folder of the recording.
        presses: Presses of the recording.
        rows: (S,) rows of the presses.
    """
    names = [REST, *(presses.names[k] for k in rows)]
    images = [cv2.imread(str(folder / "frames_bw" / name), cv2.IMREAD_GRAYSCALE) for name in names]
    moved = np.concatenate([np.zeros((1, *presses.rest.shape)), presses.moved[rows]])
    return [np.asarray(image, dtype=np.uint8) for image in images], presses.rest + moved


def areas(images: Images, at: Array) -> Array:
    """Return the (S, P) areas of the pins' blobs, px; NaN for pins that are not seen.

    Args:
        images: S frames.
        at: (S, P, 2) places of the pins, px.
    """
    sizes = [
        np.pi * blob_radii(i, np.nan_to_num(xy)) ** 2 for i, xy in zip(images, at, strict=True)
    ]
    return np.where(np.isfinite(at).all(axis=-1), sizes, np.nan)


def print_areas(folder: Path, presses: Presses) -> None:
    """Print the table of one recording."""
    pins = len(presses.rest)
    x = calibration(str(pins)).unknowns
    held = ~checkerboard(presses.labels)[0] & (indentation(x, presses.labels) > DEEP_MM)
    rows = np.random.default_rng(0).permutation(np.flatnonzero(held))[:COUNT]
    kinds = {
        "real": areas(*real(folder, presses, rows)),
        "version 2": areas(*simulated(presses, rows, 2)),
        "version 1": areas(*simulated(presses, rows, 1)),
    }
    context, name = SensorContext(np.random.SeedSequence(0)), str(pins)
    rig = SENSORS[pins][0](context, size=presses.side, calibration=name).rig
    turned = np.degrees(np.arccos(directions(rig, x)[:, 2]))
    print(f"{pins} pins, {len(rows)} held-out presses deeper than {DEEP_MM:g} mm; area, px")
    print("polar angle, deg   " + "".join(f"{kind + ': rest, pressed':>27s}" for kind in kinds))
    order = pairs(rig.rest, presses.rest)
    for low, high in pairwise(POLARS):
        mine = (turned >= low) & (turned < high)
        cells = ""
        for kind, area in kinds.items():
            some = area[:, mine[order]] if kind == "real" else area[:, mine]
            cells += f"{np.nanmean(some[0]):19.1f} {np.nanmean(some[1:]):7.1f}"
        print(f"{low:g}-{high:g} {mine.sum():14d} {cells}")


def main() -> None:
    """Print the table of every recording and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    figure = Figure(figsize=(12, 2.35 * len(given.folders)), dpi=100, layout="constrained")
    panels = figure.subplots(len(given.folders), 6, squeeze=False)
    for axes, folder in zip(panels, given.folders, strict=True):
        presses = read(folder, 1)
        print_areas(folder, presses)
        pins = len(presses.rest)
        x = calibration(str(pins)).unknowns
        depth, tilt = indentation(x, presses.labels), presses.labels.tilt
        still = np.flatnonzero(
            (abs(presses.labels.move) < STILL_MM)
            & ~np.isin(presses.names, calibration(str(pins)).frames)
        )
        off = [abs(depth - DEPTH_MM) + abs(tilt - wanted) / 4 for wanted in TILTS_DEG]
        rows = np.array([still[np.argmin(o[still])] for o in off])
        halves = (
            real(folder, presses, rows)[0],
            simulated(presses, rows, 2, **GLARE, **SENSORS[pins][1])[0],
        )
        titles = ["at rest", *(f"{depth[k]:.1f} mm, tilt {tilt[k]:.0f} deg" for k in rows)]
        for column, title in enumerate(titles):
            for half, (images, name) in enumerate(zip(halves, ("real", "simulated"), strict=True)):
                axis = axes[2 * column + half]
                axis.imshow(images[column], cmap="gray", interpolation="antialiased")
                axis.set_title(f"{name}\n{title}", fontsize=9)
                axis.set_axis_off()
    if given.out is not None:
        figure.savefig(given.out)


if __name__ == "__main__":
    main()
