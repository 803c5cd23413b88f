"""Fit version 2 of the presets tactip-127 and tactip-331 to the real sensor of a Tac-VGNN set.

    PYTHONPATH=.:plugins python benchmarks/fit_presets.py DIR SENSOR

DIR is model_surface2d of the set. It takes minutes on one core and prints the numbers that
`sensor.py` and `hooks.py` hold.

Lever and camera are fitted on the preset's own dome (ratio 50, plate without friction) to the
presses that the shipped calibration names as fitted, with its labels; drag is fitted beside them
and left out of the preset. The air between camera and window is hardly known from these fits, so it
is taken from a grid: the air with which the preset's motion is nearest to the real one in every
band of indentation. For each, the lever is such that the mean over the bands is 1 (fitted presses
that moved less than 1 mm). The sizes of the white tips are fitted by least squares to the areas of
the thresholded blobs of the rest frame, with thresholded frames of the preset; they are good to
1 %, since areas are whole pixels.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from preset_motion import PLATE, SENSORS, gain, pairs, places
from scipy.optimize import brentq

from tactibench import Pose, Scene, SensorContext
from tactibench_sim.pins import places_at_rest
from tactibench_sim.real.calibration import Unknowns, calibration
from tactibench_sim.real.comparison import DEPTHS
from tactibench_sim.real.fit import fit, rig_of
from tactibench_sim.real.plate import displacements, indentation
from tactibench_sim.real.recording import REST, Presses, read
from tactibench_sim.sensor import FITTED_THRESHOLD, Preset, SimulatedTacTip

Array = npt.NDArray[np.float64]
KIND = "50_none"
AIRS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
CAMERA = ("pin_length_mm", "gel_mm", "focal_px", "centre_x", "centre_y")
DRAG = ("drag_per_mm", "drag_per_deg", "drag_offset_mm", "drag_per_depth", "drag_per_tilt")
SLIP = ("slip_mm", "slip_power")
STILL_MM = 1.0


def band_gains(presses: Presses, x: Unknowns, label: Unknowns) -> Array:
    """Return the (B,) median gain without drag, by band of indentation.

    Args:
        presses: Real presses.
        x: Unknowns of the preset.
        label: Unknowns that turn the labels into indentation.
    """
    bare = replace(x, **dict.fromkeys((*DRAG, "rest_x", "rest_y"), 0.0))
    sim = displacements(rig_of(presses, KIND), bare, presses.labels, np.zeros(len(presses)))
    farther = gain(sim, presses.moved)
    band = np.digitize(indentation(label, presses.labels), DEPTHS)
    return np.array([np.median(farther[band == k]) for k in np.unique(band)])


def fit_optics(presses: Presses, name: str) -> Unknowns:
    """Return the unknowns with the fitted lever and camera, see the head of this file.

    Args:
        presses: Real presses.
        name: Name of the calibration that ships.
    """
    fitted = calibration(name)
    first = presses.take(np.flatnonzero(np.isin(presses.names, fitted.frames)))
    still = first.take(np.flatnonzero(abs(first.labels.move) < STILL_MM))
    begin = best = fitted.unknowns
    least = np.inf
    for air in AIRS:
        free = (*CAMERA, *DRAG, *SLIP)
        begin, loss = fit(first, rig_of(first, KIND), replace(begin, air_mm=air), free, steps=12)
        x = begin

        def off(lever: float, x: Unknowns = x) -> float:
            gains = band_gains(still, replace(x, pin_length_mm=lever), fitted.unknowns)
            return float(gains.mean()) - 1

        x = replace(x, pin_length_mm=brentq(off, 0.05, 2.0, xtol=1e-3))
        gains = band_gains(still, x, fitted.unknowns)
        apart = float(abs(gains - 1).max())
        print(f"air {air:4.2f} mm, error {loss:.3f}, lever {x.pin_length_mm:.3f}", gains.round(3))
        if apart < least:
            best, least = x, apart
    return best


def blob_radii(image: npt.NDArray[np.uint8], at: Array) -> Array:
    """Return the (P,) radii, px, of discs with the area of the blob at each (P, 2) place."""
    bright = (image > image.max() / 2).astype(np.uint8)
    _, _, stats, centres = cv2.connectedComponentsWithStats(bright, connectivity=4)
    nearest = np.linalg.norm(centres[None, 1:] - at[:, None], axis=-1).argmin(axis=1)
    return np.asarray(np.sqrt(stats[1 + nearest, cv2.CC_STAT_AREA] / np.pi))


def fit_tips(preset: Preset, kind: type[SimulatedTacTip], presses: Presses, folder: Path) -> Preset:
    """Return the preset with fitted sizes of the white tips.

    Args:
        preset: Preset whose camera and lever are fitted.
        kind: Class of the sensor.
        presses: Real presses.
        folder: Folder of the set.
    """
    frame = cv2.imread(str(folder / "frames_bw" / REST), cv2.IMREAD_GRAYSCALE)
    real = blob_radii(np.asarray(frame, dtype=np.uint8), presses.rest)
    square = (places_at_rest(preset.pins) ** 2).sum(axis=1)
    square /= square.max()
    powers = np.stack([square**0, square, square**2], axis=1)
    for _ in range(4):
        fitted_kind = type(kind.__name__, (kind,), {"versions": (preset,)})
        context = SensorContext(np.random.SeedSequence(0))
        sensor = fitted_kind(context, size=presses.side, output="bw", noise=False)
        untouched = [Scene(PLATE, Pose())]
        at = places(sensor, untouched)[0]
        drawn = sensor.renderer.project(sensor.points(untouched))[2][0]
        seen = blob_radii(sensor.rest().image, at)
        per_mm = drawn / (preset.optics.marker_radius_mm * sensor.shares)
        order = pairs(at, presses.rest)
        wanted = (drawn - seen)[order] + real  # a threshold adds nearly the same to all sizes
        scaled = powers[order] * per_mm[order, None]
        radius, two, four = np.linalg.lstsq(scaled, wanted, rcond=None)[0]
        preset = replace(
            preset,
            optics=replace(preset.optics, marker_radius_mm=round(float(radius), 4)),
            tip_square=round(float(two / radius), 3),
            tip_fourth=round(float(four / radius), 3),
        )
    order = pairs(at, presses.rest)
    print("blob radius, px, by fifths of the distance: real, simulated")
    for some in np.array_split(np.argsort(square[order]), 5):
        print(f"  {real[some].mean():.2f} {seen[order][some].mean():.2f}")
    return preset


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("sensor", choices=sorted(SENSORS))
    given = parser.parse_args()
    presses = read(given.folder, 1)
    kind = SENSORS[given.sensor]
    x = fit_optics(presses, given.sensor.removeprefix("tactip-"))
    preset = kind.preset
    optics = replace(
        preset.optics,
        camera_distance_mm=round(x.air_mm + x.gel_mm, 3),
        gel_mm=round(x.gel_mm, 3),
        window_mm=0.0,
        lens="fisheye",
        focal=round(x.focal_px / presses.side, 4),
        threshold_grey=FITTED_THRESHOLD,
    )
    lever = round(x.pin_length_mm, 3)
    preset = replace(preset, optics=optics, pin_length_mm=lever, fitted=True)
    print(fit_tips(preset, kind, presses, given.folder))


if __name__ == "__main__":
    main()
