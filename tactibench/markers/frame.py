"""One frame from pixels to pins, compiled: what ``track`` repeats."""

from __future__ import annotations

import numpy as np
from numba import njit

from tactibench.markers.blobs import levels, measure, runs, usual_area
from tactibench.markers.fit import fit
from tactibench.markers.follow import follow, foretell_unseen
from tactibench.markers.parts import GLARE, SPECK, part

HELD = 0.25
"""Standard deviation, pitches, by which a pin that is not seen is held to where it is foretold."""
STRAY = 0.5
"""A fitted pin that ends this many pitches from where it began has caught another's light."""

THERE = 0.7
"""A foretold pin whose disc grows to this share of its radius at rest has found its light."""


@njit(cache=True, nogil=True, error_model="numpy")
def find(image, glare, run, out):  # type: ignore[no-untyped-def]
    """Number of blobs, and those that may be pins (B,); out (R, 3): x, y, px, and area.

    glare: multiple of the usual area from which on a blob is a reflection.
    """
    threshold, dark, bright = levels(image)
    if threshold > 255:
        return 0, np.zeros(0, np.bool_)
    count, blobs = runs(image, threshold, run)
    blobs = min(blobs, len(out))
    measure(image, dark, dark == 0.0 and bright == 255.0, run, count, blobs, out)
    usual = usual_area(out, blobs)
    blobs = part(image, dark, bright, run, count, blobs, usual, glare, out)
    usable = np.zeros(blobs, np.bool_)
    for b in range(blobs):
        usable[b] = SPECK * usual < out[b, 2] < glare * usual
    return blobs, usable


@njit(cache=True, nogil=True, error_model="numpy")
def track(images, rest, near, back, pitch, border, xy, seen):  # type: ignore[no-untyped-def]
    """xy (N, P, 2) px and seen (N, P) of the frames (N, H, W), from blobs alone."""
    room = 8 * images.shape[1] + 20 * len(rest) + 64
    run, out = np.empty((4, room), np.int32), np.empty((room, 3))
    which = np.empty(len(rest), np.int64)
    shape = (images.shape[1], images.shape[2])
    for n in range(len(images)):
        blobs, usable = find(images[n], GLARE, run, out)
        follow(rest, near, back, pitch, border, out, blobs, usable, shape, which, xy[n])
        for p in range(len(rest)):
            seen[n, p] = which[p] >= 0
        foretell_unseen(rest, near, which, xy[n])


@njit(cache=True, nogil=True, error_model="numpy")
def refine(images, dark, contrast, edge, usual, pitch, sweeps, xy, seen, radius):  # type: ignore[no-untyped-def]
    """Fit the pins of every frame; xy, seen as of ``track`` are improved, radius (N, P) is set."""
    disc, cover = np.empty((len(usual), 3)), np.empty(dark.shape)
    held = np.empty(len(usual))
    for n in range(len(images)):
        for p in range(len(usual)):
            disc[p, 0], disc[p, 1], disc[p, 2] = xy[n, p, 0], xy[n, p, 1], usual[p]
            held[p] = np.inf if seen[n, p] else HELD * pitch[p]
        fit(images[n], dark, contrast, edge, usual, held, sweeps, disc, cover)
        for p in range(len(usual)):
            away = np.sqrt((disc[p, 0] - xy[n, p, 0]) ** 2 + (disc[p, 1] - xy[n, p, 1]) ** 2)
            radius[n, p] = disc[p, 2]
            seen[n, p] |= away < STRAY * pitch[p] and disc[p, 2] > THERE * usual[p]
            if away < STRAY * pitch[p]:
                xy[n, p, 0], xy[n, p, 1] = disc[p, 0], disc[p, 1]
