"""Blobs in which several pins touch are parted, compiled: one part for each summit of light."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

MERGED = 1.55
"""From this multiple of the usual area on a blob may be several pins."""
GLARE = 30.0
"""Beyond this one it is a reflection; in a rest frame, where pins hardly touch, beyond ``RING``."""
RING = 4.5
SPECK = 0.3
"""Below this one it is none."""
FULL = 0.5
"""A summit's window is this much filled with light, or it is a mere corner of a blob."""


@njit(cache=True, nogil=True, error_model="numpy")
def _sum(image, dark, i, j, half):  # type: ignore[no-untyped-def]
    """Light over the dark level in the window of 2 half + 1 px around a pixel."""
    total = 0.0
    for a in range(max(0, i - half), min(image.shape[0], i + half + 1)):
        for b in range(max(0, j - half), min(image.shape[1], j + half + 1)):
            total += max(image[a, b] - dark, 0.0)
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def part(image, dark, bright, run, count, blobs, usual, glare, out):  # type: ignore[no-untyped-def]
    """Append the parts of merged blobs to out (B, 3); the merged ones get area 0.

    A summit is a pixel whose window, of about a pin's size, holds more light than those of its
    eight neighbours; each pixel of the blob goes to the nearest summit. Returns the new number.
    """
    most = len(out)
    half = max(1, int(0.62 * math.sqrt(usual / math.pi) + 0.5))
    least = FULL * (bright - dark) * min((2.0 * half + 1.0) ** 2, 0.8 * usual)
    made = blobs
    first = np.full(blobs + 1, -1)  # chains of the runs of merged blobs
    chain = np.empty(count, np.int64)
    for k in range(count):
        b = run[3, k]
        if MERGED * usual < out[b, 2] < glare * usual:
            chain[k] = first[b]
            first[b] = k
    for b in range(blobs):
        if first[b] < 0:
            continue
        start = made
        k = first[b]
        while k >= 0:
            i = run[0, k]
            for j in range(run[1, k], run[2, k]):
                here = _sum(image, dark, i, j, half)
                if here < least or made == most:
                    continue
                summit = True
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        if summit and (di or dj):
                            there = _sum(image, dark, i + di, j + dj, half)
                            later = di > 0 or (di == 0 and dj > 0)
                            summit = here > there or (later and here == there)
                if summit:
                    out[made, 0], out[made, 1], out[made, 2] = j, i, 0.0
                    made += 1
            k = chain[k]
        if made - start < 2:
            made = start
            continue
        sums = np.zeros((made - start, 4))
        k = first[b]
        while k >= 0:
            i = run[0, k]
            for j in range(run[1, k], run[2, k]):
                best, mine = np.inf, 0
                for s in range(start, made):
                    square = (out[s, 0] - j) ** 2 + (out[s, 1] - i) ** 2
                    if square < best:
                        best, mine = square, s - start
                w = image[i, j] - dark
                sums[mine, 0] += w * j
                sums[mine, 1] += w * i
                sums[mine, 2] += 1.0
                sums[mine, 3] += w
            k = chain[k]
        for s in range(made - start):
            out[start + s, 0] = sums[s, 0] / sums[s, 3]
            out[start + s, 1] = sums[s, 1] / sums[s, 3]
            out[start + s, 2] = sums[s, 2]
        out[b, 2] = 0.0
    return made
