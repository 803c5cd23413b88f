"""Measure pins: coverage and speed on real frames, precision on simulated ones, graphs a second.

    python -P benchmarks/pins.py [--every 10] [--frames 200]

(-P keeps files of this folder from hiding packages of the same name.)

* real: the frames of the Tac-VGNN sets (TACTIBENCH_TACVGNN, or ../shared/data/tac-vgnn) on one
  thread, without the time to read them. The tracker takes turns on the same frames with connected
  components and one Hungarian assignment of all blobs to all pins at rest. ``seen`` is the share of
  pins that were seen; the others are predicted from their neighbours. ``whole`` is the share of
  frames with every pin seen. ``rough`` is the worst displacement of a seen pin against the plane
  through those of its neighbours, pitches.
* simulated: rms error of the tracked positions against the positions that the renderer drew, px an
  axis, beside the Cramer-Rao limit of all pins' positions and radii together. ``bias`` is the rms
  over tenths of a pixel of the mean error there, with the value that noise alone would give.
  ``lost`` is the share of pins more than half a pixel off, which the rms of the others leaves out.
* graph: pins to edges, cell areas and border, beside ``scipy.spatial.Delaunay`` alone.

Times are processor time of this thread, on which other work of the machine has little influence.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import csv
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import Delaunay, cKDTree
from scipy.spatial.distance import cdist

from tactibench import Indenter, Pose, Scene, SensorContext
from tactibench.markers import Tracker, Tracks, pin_graph
from tactibench.plugins import PluginHost
from tactibench_sim import Renderer, SimulatedSensor

DATA = Path(
    os.environ.get(
        "TACTIBENCH_TACVGNN",
        Path(__file__).resolve().parents[1].parent / "shared" / "data" / "tac-vgnn",
    )
)
BLOCK = 50
LOST_PX = 0.5
Result = TypeVar("Result")


def timed(work: Callable[[], Result]) -> tuple[Result, float]:
    """Return what a function returns, and its processor time, s."""
    start = time.thread_time()
    result = work()
    return result, time.thread_time() - start


def gray(path: Path) -> np.ndarray:
    """Return the (H, W) uint8 picture of a file."""
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise SystemExit(f"{path} is no picture that can be read.")
    return np.asarray(image, dtype=np.uint8)


def hungarian(images: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Return the (N, P, 2) pins by assignment of every blob to every pin, as is usually done, px.

    Args:
        images: (N, H, W) frames.
        rest: (P, 2) pins at rest, px.
    """
    out = np.full((len(images), len(rest), 2), np.nan)
    for image, places in zip(images, out, strict=True):
        _, bright = cv2.threshold(image, 0, 1, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
        boxes, middles = cv2.connectedComponentsWithStats(bright, connectivity=4)[2:]
        area = boxes[1:, cv2.CC_STAT_AREA]
        usual = np.median(area)
        blobs = middles[1:][(area > 0.3 * usual) & (area < 4.5 * usual)]
        row, column = linear_sum_assignment(cdist(rest, blobs, "sqeuclidean"))
        places[row] = blobs[column]
    return out


def roughness(tracks: Tracks, rest: np.ndarray) -> np.ndarray:
    """Return the (N,) worst displacement of a seen pin in each frame, pitches.

    It is taken against the plane through the displacements of ten neighbours.

    Args:
        tracks: Pins of N frames.
        rest: (P, 2) pins at rest, px.
    """
    apart, near = (columns[:, 1:] for columns in cKDTree(rest).query(rest, k=11))
    basis = np.concatenate([np.ones((*near.shape, 1)), rest[near] - rest[:, None]], axis=2)
    plane = np.linalg.pinv(basis)[:, 0]
    moved = tracks.xy - rest
    off = moved - np.einsum("pk,npkc->npc", plane, moved[:, near])
    pitches = np.linalg.norm(off, axis=-1) / apart[:, :4].mean(axis=1)
    return np.asarray(np.where(tracks.seen, pitches, 0.0).max(axis=1))


def show_real(pins: str, every: int) -> np.ndarray | None:
    folder = DATA / pins / "model_surface2d"
    if not (folder / "targets.csv").is_file():
        print(f"real {pins}: skipped, {folder} is not there; set TACTIBENCH_TACVGNN")
        return None
    with (folder / "targets.csv").open(newline="") as table:
        names = [row["image_name"] for row in csv.DictReader(table)][::every]
    rest = gray(folder / "frames_bw" / "init_0.png")
    tracker = Tracker(rest, refine=False)
    ours = theirs = 0.0
    parts = []
    tracker.track(rest[None])
    for start in range(0, len(names), BLOCK):
        block = names[start : start + BLOCK]
        images = np.stack([gray(folder / "frames_bw" / name) for name in block])
        found, spent = timed(partial(tracker.track, images))
        parts.append(found)
        ours += spent
        theirs += timed(partial(hungarian, images, tracker.rest))[1]
    tracks = Tracks(*(np.concatenate([getattr(p, n) for p in parts]) for n in vars(parts[0])))
    rough = roughness(tracks, tracker.rest)
    covered = np.isfinite(tracks.xy).all(axis=(1, 2)).mean()
    print(
        f"real {pins}: {len(names)} frames, {len(tracker.rest)} pins; coverage {covered:.2%}, "
        f"seen {tracks.seen.mean():.4%}, whole {tracks.seen.all(axis=1).mean():.2%}, "
        f"rough median {np.median(rough):.2f}, 99 % {np.quantile(rough, 0.99):.2f}, "
        f"most {rough.max():.2f}"
    )
    print(
        f"real {pins}: {len(names) / ours:,.0f} frames/s; Hungarian {len(names) / theirs:,.0f}; "
        f"ratio {theirs / ours:.1f}"
    )
    return tracks.xy


def scenes(rng: np.random.Generator, count: int) -> list[Scene]:
    """Return presses of one, two and three tips in turn."""
    out = []
    for k in range(count):
        heights = tuple(rng.uniform(0, 2, 3))
        indenter = (
            Indenter.single(),
            Indenter.dual(rng.uniform(6.5, 12)),
            Indenter.triple((heights[0], heights[1], heights[2])),
        )[k % 3]
        reach, deepest = ((6.4, 6.0), (1.5, 5.0), (1.0, 5.0))[k % 3]
        x, y = rng.uniform(-reach, reach, 2)
        out.append(
            Scene(indenter, Pose(x, y, rng.uniform(-180, 180), 0, rng.uniform(2.5, deepest)))
        )
    return out


def limit(renderer: Renderer, discs: np.ndarray) -> float:
    """Return the Cramer-Rao limit of one frame: rms over all pins, px an axis.

    The x, y and radius of every pin are unknown.

    Args:
        renderer: Renderer of the sensor.
        discs: (P, 3) x, y and radius of the pins, px.
    """
    clean = renderer.clean_discs(*discs.T[:, None])[0]
    weight = 1 / np.sqrt(renderer.variance(clean).ravel())
    step = 1e-3
    jacobian = np.empty((discs.size, clean.size), dtype=np.float32)
    for k in range(discs.size):
        ahead, behind = discs.copy(), discs.copy()
        ahead.flat[k] += step
        behind.flat[k] -= step
        pair = [renderer.clean_discs(*d.T[:, None])[0].ravel() for d in (ahead, behind)]
        jacobian[k] = (pair[0] - pair[1]) / (2 * step) * weight
    spread = np.diag(np.linalg.inv((jacobian @ jacobian.T).astype(np.float64)))
    return float(np.sqrt(np.mean(spread.reshape(-1, 3)[:, :2])))


def show_simulated(host: PluginHost, name: str, count: int) -> None:
    sensor = host.sensors[name].build(SensorContext(np.random.SeedSequence(7)))
    assert isinstance(sensor, SimulatedSensor)  # noqa: S101 - both are simulated
    drawn = scenes(np.random.default_rng(11), count)
    images = np.stack([frame.image for frame in sensor.press_many(drawn)])
    discs = np.stack(sensor.renderer.project(sensor.points(drawn)), axis=-1)
    true = discs[..., :2]
    rest = sensor.rest().image
    for kind in ("profile", "centroid"):
        tracker = Tracker(rest, refine=kind == "profile")
        tracker.track(images[:1])
        tracks, spent = timed(partial(tracker.track, images))
        still = np.stack(sensor.renderer.project(sensor.points([_untouched()])), axis=-1)[0, :, :2]
        order = cKDTree(tracker.rest).query(still)[1]
        error = tracks.xy[:, order] - true
        near = np.linalg.norm(error, axis=-1) < LOST_PX
        tracked = error[near]
        phase = np.floor(10 * (true[near] % 1)).astype(int)
        means = [tracked[phase == k].mean() for k in range(10)]
        left = np.sqrt(np.mean([tracked[phase == k].var() / np.sum(phase == k) for k in range(10)]))
        print(
            f"{name} {kind}: rms {np.sqrt(np.mean(tracked**2)):.4f} px, median |e| "
            f"{np.median(np.abs(tracked)):.4f}, bias {np.sqrt(np.mean(np.square(means))):.4f} "
            f"(noise alone {left:.4f}), lost {1 - near.mean():.3%}, seen "
            f"{tracks.seen.mean():.3%}; {count / spent:,.0f} frames/s"
        )
    limits = [limit(sensor.renderer, d) for d in discs[: max(1, min(6, count))]]
    print(f"{name} limit: rms {np.sqrt(np.mean(np.square(limits))):.4f} px ({len(limits)} frames)")


def _untouched() -> Scene:
    return Scene(Indenter.single(), Pose())


def show_graphs(label: str, xy: np.ndarray) -> None:
    pin_graph(xy[0])
    _, ours = timed(lambda: [pin_graph(places) for places in xy])
    _, theirs = timed(lambda: [Delaunay(places) for places in xy])
    print(
        f"graph {label}: {len(xy) / ours:,.0f} graphs/s; scipy Delaunay alone "
        f"{len(xy) / theirs:,.0f}/s; ratio {theirs / ours:.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--every", type=int, default=1, help="take each so manieth real frame")
    parser.add_argument("--frames", type=int, default=200, help="simulated frames")
    options = parser.parse_args()
    host = PluginHost()
    for pins in ("331", "127"):
        xy = show_real(pins, options.every)
        if xy is None:
            image = host.sensors[f"tactip-{pins}"].build(SensorContext(np.random.SeedSequence(7)))
            rest = Tracker(image.rest().image).rest
            xy = rest + np.random.default_rng(5).normal(0, 0.3, (200, *rest.shape))
        show_graphs(pins, xy[:: max(1, len(xy) // 500)])
    for name in ("tactip-127", "tactip-331"):
        show_simulated(host, name, options.frames)


if __name__ == "__main__":
    main()
