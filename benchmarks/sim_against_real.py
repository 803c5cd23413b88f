"""Compare the fitted simulator with recorded plate presses, and fit it to a recording.

    PYTHONPATH=.:plugins python benchmarks/sim_against_real.py DIR [--fit OUT] [--picture PNG]

DIR is model_surface2d of a Tac-VGNN set, or a folder like it: targets.csv with the columns
image_name, pose_2 (depth, mm), pose_6 (tilt, deg), move_1 (sideways, mm) and move_6 (turn, deg),
and frames_bw with init_0.png. The table compares the calibration that ships for as many pins, on
presses of the blocks of tilt and depth that no fit saw: median over presses of
||sim - real|| / ||real|| from the labels alone and where the frame decides whether the plate
dragged the skin, and the gain <real, sim> / <sim, sim>. Then what tactip-* take from recordings:
how far their pins move beside the real ones, the coefficient of friction at which the plate slips,
and how it scatters from press to press.

--fit fits camera, lever, drag and slip to 400 presses of the other blocks in some minutes, writes
the numbers for --param sensor.calibration=OUT, and compares them. --picture draws the real rest
frame and two presses beside simulated ones.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure
from scipy.optimize import least_squares, linear_sum_assignment

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.datasets import ImportOptions, cached_fit, open_recording
from tactibench.markers import Tracker
from tactibench_sim import (
    Calibration,
    Fitted127,
    Fitted331,
    LabelFit,
    Labels,
    Rig,
    TacTip127,
    TacTip331,
    Unknowns,
    calibration_of,
    changes,
    indentation,
    plate_of,
    shipped_dome,
    tip_drag,
)

Array = npt.NDArray[np.float64]
COLUMNS = ("pose_2", "pose_6", "move_1", "move_6")
KINDS = ("10_stick", "50_stick", "300_stick")
CELLS, COUNT, STEPS = 4, 400, 30
"""Columns and rows of the checkerboard of tilt and depth; presses that are fitted; evaluations."""
MOVES, DEPTHS = (0.0, 1.0, 2.0, 3.5, 5.01), (0.0, 2.0, 3.0, 4.0, 5.0, 8.0)
STEP = dict.fromkeys((field.name for field in fields(Unknowns)), 0.1) | {
    "depth_offset_mm": 0.5,
    "pivot_mm": 5.0,
    "pivot_side_mm": 1.0,
    "tilt_offset_deg": 2.0,
    "yaw_deg": 1.0,
    "pin_length_mm": 0.3,
    "air_mm": 1.0,
    "gel_mm": 2.0,
    "focal_px": 10.0,
    "centre_x": 2.0,
    "centre_y": 2.0,
    "drag_per_mm": 0.2,
    "drag_per_deg": 0.01,
    "drag_per_depth": 0.02,
    "slip_power": 0.2,
    "give_per_mm": 0.01,
    "rest_x": 0.3,
    "rest_y": 0.3,
}
"""Step of each unknown; these steps change the presses by a similar amount."""
BOUNDS = {
    "air_mm": (0.05, 100.0),
    "gel_mm": (10.0, 60.0),
    "focal_px": (20.0, 2000.0),
    "slip_mm": (0.0, 10.0),
    "slip_power": (0.0, 3.0),
    "give_per_mm": (0.0, 0.07),  # at 0.07 the dome would yield more than half at 7 mm of travel
}


class Presses(NamedTuple):
    """N recorded presses.

    Attributes:
        names: (N,) names of the frames.
        labels: Labels of the presses.
        rest: (P, 2) places of the pins at rest, px.
        moved: (N, P, 2) displacements of the pins, px; NaN for pins that were not seen.
        side: Side of the frames, px.
    """

    names: npt.NDArray[np.str_]
    labels: Labels
    rest: Array
    moved: Array
    side: int

    def some(self, rows: npt.NDArray[np.intp]) -> Presses:
        """Return some of the presses."""
        labels, moved = self.labels.take(rows), self.moved[rows]
        return Presses(self.names[rows], labels, self.rest, moved, self.side)


def grey(folder: Path, name: str) -> npt.NDArray[np.uint8]:
    """Return a frame of a recording."""
    image = cv2.imread(str(folder / "frames_bw" / name), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SystemExit(f"{name} of {folder} is not there or no picture")
    return np.asarray(image, dtype=np.uint8)


def read(folder: Path) -> Presses:
    """Return all presses of a recording."""
    rows = pd.read_csv(folder / "targets.csv")
    tracker = Tracker(grey(folder, "init_0.png"))
    moved = np.empty((len(rows), *tracker.rest.shape))
    for k, name in enumerate(rows["image_name"]):
        tracks = tracker.track(grey(folder, name)[None])
        moved[k] = np.where(tracks.seen[0, :, None], tracks.xy[0] - tracker.rest, np.nan)
    labels = Labels(*(rows[column].to_numpy(float) for column in COLUMNS))
    names = rows["image_name"].to_numpy(str)
    return Presses(names, labels, tracker.rest, moved, len(grey(folder, "init_0.png")))


def checkerboard(labels: Labels) -> npt.NDArray[np.bool_]:
    """Return (N,) whether each press is of a block of tilt and depth that may be fitted.

    A plate is fitted at some tilts and depths and tested at others, so an error is that of
    interpolation between blocks and not between neighbours.
    """
    column, row = (
        np.minimum((CELLS * (v - v.min()) / np.ptp(v)).astype(np.intp), CELLS - 1)
        for v in (labels.tilt, labels.depth)
    )
    return np.asarray((column + row) % 2 == 0)


def errors(presses: Presses, rig: Rig, x: Unknowns) -> tuple[Array, Array, Array]:
    """Return (N,) relative errors from the labels, with the drag state known, and gains."""
    real, relative, sims = presses.moved, [], []
    for dragged in (1.0, 0.0):
        sim = changes(rig, x, presses.labels, np.full(len(real), dragged))[..., :2]
        off = np.nansum((sim - real) ** 2, axis=(1, 2)) / np.nansum(real**2, axis=(1, 2))
        relative.append(np.sqrt(off))
        sims.append(np.where(np.isfinite(real), sim, 0.0))
    sim = np.where((relative[1] < relative[0])[:, None, None], sims[1], sims[0])
    gain = np.nansum(sim * real, axis=(1, 2)) / (sim**2).sum(axis=(1, 2))
    return relative[0], np.minimum(*relative), gain


def fit(presses: Presses, rig: Rig, begin: Unknowns) -> tuple[Unknowns, float]:
    """Return the unknowns of least mean relative error over presses, and that error.

    The sum is of norms and not of squares, so that one press with a wrong label weighs no more than
    any other. Each press counts as dragged or as not, whichever fits better. A third of the pins is
    fitted.
    """
    fewer, real = replace(rig, rest=rig.rest[::3]), presses.moved[:, ::3]
    weight = 1 / np.sqrt(np.nansum(real**2, axis=(1, 2)))[:, None, None]
    origin, step = np.array(list(asdict(begin).values())), np.array(list(STEP.values()))

    def unknowns(vector: Array) -> Unknowns:
        return Unknowns(*(origin + step * vector).tolist())

    def residuals(vector: Array) -> Array:
        x, both = unknowns(vector), []
        for dragged in (1.0, 0.0):
            sim = changes(fewer, x, presses.labels, np.full(len(real), dragged))[..., :2]
            both.append(np.nan_to_num((sim - real) * weight).reshape(len(real), -1))
        worse = (both[0] ** 2).sum(axis=1) > (both[1] ** 2).sum(axis=1)
        best = np.where(worse[:, None], both[1], both[0])
        norm = np.sqrt((best**2).sum(axis=1) + 1e-6)  # rounded at 0, where it has no slope
        return np.asarray((best / np.sqrt(norm)[:, None]).ravel())

    free = (-np.inf, np.inf)
    limits = (np.array([BOUNDS.get(name, free) for name in STEP]) - origin[:, None]) / step[:, None]
    found = least_squares(residuals, 0 * origin, bounds=tuple(limits.T), max_nfev=STEPS)
    return unknowns(found.x), float(2 * found.cost / len(real))


def calibrate(folder: Path, presses: Presses) -> Calibration:
    """Return the fit to COUNT presses of the blocks that may be fitted."""
    recording = open_recording(folder)
    rows = np.flatnonzero(checkerboard(presses.labels))
    first = presses.some(np.sort(np.random.default_rng(0).permutation(rows)[:COUNT]))
    x, y = presses.rest.mean(axis=0)
    begin = Unknowns(centre_x=float(x), centre_y=float(y), focal_px=110.0 * presses.side / 360)
    fits = []
    for kind in KINDS:
        begin, loss = fit(first, Rig(plate_of(kind), presses.rest, presses.side), begin)
        fits.append((loss, kind, begin))
    _, kind, best = min(fits, key=lambda one: one[0])
    pivot = cached_fit(recording, ImportOptions()).pivot
    labels = LabelFit(pivot.offset_mm, pivot.pivot_mm, pivot.side_mm)
    names, centre = tuple(sorted(first.names.tolist())), (float(x), float(y))
    return Calibration(recording.sha256, names, presses.side, centre, kind, best, labels)


def print_errors(presses: Presses, calibration: Calibration) -> None:
    """Print the table of the presses of blocks that no fit saw."""
    held = presses.some(np.flatnonzero(~checkerboard(presses.labels)))
    rig = Rig(plate_of(calibration.kind), presses.rest, presses.side)
    table = pd.DataFrame(np.transpose(errors(held, rig, calibration.unknowns)))
    table.columns = ["relative", "drag known", "gain"]
    print(f"{len(presses.rest)} pins, medians over {len(held.names)} held-out presses")
    depth = indentation(calibration.unknowns, held.labels)
    for name, values, edges in (
        ("move", abs(held.labels.move), MOVES),
        ("indentation", depth, DEPTHS),
    ):
        bands = pd.cut(values, edges, right=False)
        groups = table.assign(band=bands).groupby("band", observed=True)
        print(groups.median().round(3).assign(presses=groups.size()).rename_axis(f"{name}, mm"))
    print(f"all: {table.median().round(3).to_dict()}")


def print_motion(presses: Presses, calibration: Calibration) -> None:
    """Print real over simulated motion of the pins of tactip-*, by indentation.

    Held-out presses that hardly moved are pressed by the sensor's own plate, with its friction.
    """
    x, plate = calibration.unknowns, Indenter.plate()
    kind = TacTip331 if len(presses.rest) == 331 else TacTip127
    sensor = kind(SensorContext(np.random.SeedSequence(0)), size=presses.side)
    held = presses.some(np.flatnonzero(~checkerboard(presses.labels)))
    held = held.some(np.flatnonzero(abs(held.labels.move) < MOVES[1]))
    depth, tilt = indentation(x, held.labels), held.labels.tilt + x.tilt_offset_deg
    poses = [Pose(), *(Pose(0, 0, x.yaw_deg, *at) for at in zip(tilt, depth.clip(0), strict=True))]
    seen = sensor.renderer.project(sensor.points([Scene(plate, pose) for pose in poses]))
    places = np.stack(seen[:2], axis=-1)
    apart = presses.rest[:, None] - places[0] - (presses.rest.mean(axis=0) - places[0].mean(axis=0))
    order = linear_sum_assignment((apart**2).sum(axis=-1))[1]
    sim = np.where(np.isfinite(held.moved), (places[1:] - places[0])[:, order], 0.0)
    ratio = np.sqrt(np.nansum(held.moved**2, axis=(1, 2)) / (sim**2).sum(axis=(1, 2)))
    table = pd.DataFrame({"ratio": ratio, "band": pd.cut(depth, DEPTHS, right=False)})
    bands = table.groupby("band", observed=True)["ratio"].median()
    print(f"real over simulated motion, tactip-{len(presses.rest)}, {len(ratio)} presses")
    print(f"by indentation: {bands.round(3).to_dict()}; all: {np.median(ratio):.3f}")


def print_friction(presses: Presses, calibration: Calibration) -> None:
    """Print the coefficient at which the plate slips, and its scatter from press to press.

    The scatter is of presses that moved far and were dragged: the drag that fits the frame best,
    over the limit of the fit, less its trends with the labels.
    """
    x, dome, drag = calibration.unknowns, shipped_dome().by_radius[np.inf], tip_drag(np.inf)
    at = np.arange(2.0, 5.5)
    force = np.interp(at, dome.delta, dome.fields["force"])
    friction = x.slip_mm * at**x.slip_power / (force * drag.compliance_at(at))
    print(f"friction 2 to 5 mm deep: {friction.round(2).tolist()}")
    depth = indentation(x, presses.labels)
    far = (abs(presses.labels.move) > MOVES[3]) & (depth > 1.5) & (depth < 5.5)
    some = presses.some(np.flatnonzero(far & ~np.isin(presses.names, calibration.frames)))
    rig, count = Rig(plate_of(calibration.kind), presses.rest, presses.side), len(some.names)
    bare, full = (changes(rig, x, some.labels, np.full(count, one))[..., :2] for one in (0.0, 1.0))
    part = np.where(np.isfinite(some.moved), full - bare, 0.0)
    share = np.nansum((some.moved - bare) * part, axis=(1, 2)) / (part**2).sum(axis=(1, 2))
    dragged = np.flatnonzero(share > 0.5)
    labels, side = some.labels.take(dragged), np.sign(some.labels.move[dragged])
    d = indentation(x, labels)
    trends = [1 + 0 * d, d, d**2, labels.tilt, labels.tilt**2, labels.turn, abs(labels.move)]
    trends += [side, side * d, side * labels.tilt, side * labels.turn]
    off = np.log(share[dragged])
    off -= (trend := np.column_stack(trends)) @ np.linalg.lstsq(trend, off, rcond=None)[0]
    print(f"scatter from press to press: {1.4826 * np.median(abs(off)):.2f}, {len(off)} presses")


def draw(folder: Path, presses: Presses, calibration: Calibration, path: Path) -> None:
    """Draw the rest frame and two hardly moved presses, real beside simulated."""
    large = len(presses.rest) == 331
    kind = Fitted331 if large else Fitted127
    sensor = kind(
        SensorContext(np.random.SeedSequence(0)),
        size=presses.side,
        drag=0.0,
        output="bw",
        glare=1.0,
        glare_scatter=0.6,
        glare_seed=3,
        glare_radius=0.465 if large else 0.475,
    )
    depth, tilt = indentation(calibration.unknowns, presses.labels), presses.labels.tilt
    unseen = (abs(presses.labels.move) < 0.5) & ~np.isin(presses.names, calibration.frames)
    rows = np.flatnonzero(unseen)
    chosen = [rows[np.argmin((abs(depth - 3.5) + abs(tilt - t) / 4)[rows])] for t in (0.0, 12.0)]
    panels = [("at rest", grey(folder, "init_0.png"), sensor.rest().image)]
    for k in chosen:
        pose = Pose(yaw=90.0, tilt=float(tilt[k]), depth=float(depth[k]))
        image = sensor.press(Scene(Indenter.plate(), pose)).image
        title = f"{depth[k]:.1f} mm, tilt {tilt[k]:.0f} deg"
        panels.append((title, grey(folder, presses.names[k]), image))
    figure = Figure(figsize=(12, 2.35), dpi=100, layout="constrained")
    axes = figure.subplots(1, 2 * len(panels))
    for k, (title, *pair) in enumerate(panels):
        for half, (image, name) in enumerate(zip(pair, ("real", "simulated"), strict=True)):
            axes[2 * k + half].imshow(image, cmap="gray", interpolation="antialiased")
            axes[2 * k + half].set_title(f"{name}\n{title}", fontsize=9)
            axes[2 * k + half].set_axis_off()
    figure.savefig(path)


def main() -> None:
    """Print the table, and fit or draw what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fit", type=Path, metavar="OUT")
    parser.add_argument("--picture", type=Path, metavar="PNG")
    given = parser.parse_args()
    presses = read(given.folder)
    if given.fit:
        calibration = calibrate(given.folder, presses)
        given.fit.write_text(json.dumps(asdict(calibration), indent=1) + "\n", encoding="utf-8")
    else:
        calibration = calibration_of(len(presses.rest))
    print_errors(presses, calibration)
    print_motion(presses, calibration)
    print_friction(presses, calibration)
    if given.picture:
        draw(given.folder, presses, calibration, given.picture)


if __name__ == "__main__":
    main()
