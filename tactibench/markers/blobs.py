"""Bright blobs of a frame, compiled: runs of bright pixels, joined by rows, merged ones split.

A run is a stretch of bright pixels in a row. Runs that share a column in successive rows are one
blob (4-connectivity), so that pins which only touch at corners stay two. A blob in which several
pins touch is split, one piece for each summit of light.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

FAINTEST = 20
"""Grey levels between darkest and brightest pixel below which a frame holds no marker."""
MERGED = 1.55
"""Multiple of the usual area above which a blob may be several pins."""
GLARE = 30.0
"""Multiple of the usual area above which a blob is a reflection."""
RING = 4.5
"""The same for a rest frame, where pins hardly touch."""
WIDEST = 16
"""Half a summit's window, px, beyond which blobs are surfaces and no pins: a pin that is 50 px wide
has 16, and a larger window costs seconds."""
SPECK = 0.3
"""Share of the usual area below which a blob is no pin."""
FULL = 0.5
"""Share of a summit's window that light must fill; with less it is only a corner of a blob."""

_NUMBERED = np.uint64(0xE0C0A08060402000)
"""Times 2^(8 k): 7 - k in the three highest bits."""


@njit(cache=True, nogil=True, error_model="numpy")
def find_levels(image):  # type: ignore[no-untyped-def]
    """Return a threshold and the mean levels below and above it; 256 for an even frame.

    Otsu's threshold (IEEE Trans. SMC 9, 1979) of every k-th row, about 120 of them, and of every
    second pixel: enough for two levels, at an eighth of the cost.
    """
    height, width = image.shape
    counts = np.zeros((4, 256), np.int64)  # four: equal neighbours do not wait for each other
    step = max(1, height // 120)
    skip = 2 if width >= 240 else 1
    for i in range(0, height, step):
        row = image[i]
        for j in range(0, width - 3 * skip, 4 * skip):
            counts[0, row[j]] += 1
            counts[1, row[j + skip]] += 1
            counts[2, row[j + 2 * skip]] += 1
            counts[3, row[j + 3 * skip]] += 1
    total, weighted, low, high = 0.0, 0.0, 256, -1
    for v in range(256):
        counts[0, v] += counts[1, v] + counts[2, v] + counts[3, v]
        if counts[0, v]:
            low, high = min(low, v), v
        total += counts[0, v]
        weighted += v * counts[0, v]
    if high - low < FAINTEST:
        return 256, float(low), float(high)
    best, threshold, dark, bright = -1.0, 256, 0.0, 0.0
    below, sum_below = 0.0, 0.0
    for v in range(low, high):
        below += counts[0, v]
        sum_below += v * counts[0, v]
        if below > 0:
            dark_mean = sum_below / below
            bright_mean = (weighted - sum_below) / (total - below)
            between = below * (total - below) * (bright_mean - dark_mean) ** 2
            if between > best:
                best, threshold, dark, bright = between, v, dark_mean, bright_mean
    return threshold, dark, bright


@njit(cache=True, nogil=True, error_model="numpy")
def _root(parent, k):  # type: ignore[no-untyped-def]
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@njit(cache=True, nogil=True, error_model="numpy")
def _bright(image, threshold, mask):  # type: ignore[no-untyped-def]
    """Set mask (H, S) to 1 where a pixel is bright; S, a multiple of 8, exceeds the width W.

    Columns beyond the frame's width stay 0.
    """
    most = np.uint8(min(threshold, 255))
    for i in range(image.shape[0]):
        row, out = image[i], mask[i]
        for j in range(row.shape[0]):
            out[j] = row[j] > most


@njit(cache=True, nogil=True, error_model="numpy")
def find_runs(image, threshold, run):  # type: ignore[no-untyped-def]
    """Find the runs of bright pixels and join them to blobs.

    Eight pixels are handled together: where a word differs from itself moved by one pixel, a run
    begins or ends.

    Args:
        image: (H, W) grey levels.
        threshold: Level above which a pixel is bright.
        run: (4, R), set to row, first column, column after the last and blob number of each run.
            Runs after the first R are left out.

    Returns:
        The number of runs and the number of blobs.
    """
    height, width = image.shape
    most = run.shape[1]
    stride = (width // 8 + 1) * 8
    mask = np.zeros((height, stride), np.uint8)
    _bright(image, threshold, mask)
    packed = mask.reshape(-1).view(np.uint64)
    words = stride // 8
    count, before = 0, 0  # runs so far; the first run of the row above
    for i in range(height):
        above, first = before, count
        carry, start = np.uint64(0), np.int64(-1)
        for k in range(words):
            word = packed[i * words + k]
            borders = word ^ ((word << np.uint64(8)) | carry)
            carry = word >> np.uint64(56)
            while borders:
                lowest = borders & (~borders + np.uint64(1))
                borders ^= lowest
                j = 8 * k + 7 - np.int64((lowest * _NUMBERED) >> np.uint64(61))
                if start < 0:
                    start = j
                    continue
                if count < most:
                    run[0, count], run[1, count], run[2, count] = i, start, j
                    run[3, count] = count
                    while above < first and run[2, above] <= start:
                        above += 1
                    other = above
                    while other < first and run[1, other] < j:
                        a, b = _root(run[3], other), _root(run[3], count)
                        if a < b:
                            run[3, b] = a
                        elif b < a:
                            run[3, a] = b
                        other += 1
                    count += 1
                start = np.int64(-1)
        before = first
    blobs = 0
    for k in range(count):  # parents come first
        if run[3, k] == k:
            run[3, k] = -1 - blobs
            blobs += 1
        else:
            run[3, k] = run[3, run[3, k]]
    for k in range(count):
        run[3, k] = -1 - run[3, k]
    return count, blobs


@njit(cache=True, nogil=True, error_model="numpy")
def measure_blobs(image, dark, binary, run, count, blobs, out):  # type: ignore[no-untyped-def]
    """Set out (B, 3) to centroid x, y, px, and area, px, of every blob.

    Centroids are weighted by the light over the dark level, or evenly in a binary frame.

    Args:
        image: (H, W) grey levels.
        dark: Mean level of dark pixels.
        binary: Whether the frame is black and white.
        run: Runs of bright pixels, as ``find_runs`` sets them.
        count: Number of runs.
        blobs: Number of blobs.
        out: (B, 3), set to the result.
    """
    weight = np.zeros(blobs)
    out[:blobs] = 0.0
    for k in range(count):
        i, start, stop, b = run[0, k], run[1, k], run[2, k], run[3, k]
        length = stop - start
        if binary:
            across, light = 0.5 * (start + stop - 1) * length, float(length)
        else:
            across, light = 0.0, 0.0
            for j in range(start, stop):
                w = image[i, j] - dark
                light += w
                across += w * j
        out[b, 0] += across
        out[b, 1] += light * i
        out[b, 2] += length
        weight[b] += light
    for b in range(blobs):
        out[b, 0] /= weight[b]
        out[b, 1] /= weight[b]


@njit(cache=True, nogil=True, error_model="numpy")
def usual_area(out, blobs):  # type: ignore[no-untyped-def]
    """Return the median area of blobs that are no specks, px; specks may outnumber the markers.

    Args:
        out: (B, 3) centroid x, y, px, and area, px, of every blob.
        blobs: Number of blobs.
    """
    if blobs == 0:
        return 0.0
    area = out[:blobs, 2].copy()
    return np.median(area[area >= area.mean() / 4])


@njit(cache=True, nogil=True, error_model="numpy")
def _light_around(image, dark, i, j, half):  # type: ignore[no-untyped-def]
    """Return the light over the dark level in the window of 2 half + 1 px around a pixel."""
    total = 0.0
    for a in range(max(0, i - half), min(image.shape[0], i + half + 1)):
        for b in range(max(0, j - half), min(image.shape[1], j + half + 1)):
            total += max(image[a, b] - dark, 0.0)
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def split_merged(image, dark, bright, run, count, blobs, usual, glare, out):  # type: ignore[no-untyped-def]
    """Append the parts of merged blobs to out (B, 3) and set the area of merged blobs to 0.

    A summit is a pixel whose window, of about a pin's size, holds more light than those of its
    eight neighbours; each pixel of the blob goes to the nearest summit.

    Args:
        image: (H, W) grey levels.
        dark: Mean level of dark pixels.
        bright: Mean level of bright pixels.
        run: Runs of bright pixels, as ``find_runs`` sets them.
        count: Number of runs.
        blobs: Number of blobs.
        usual: Usual area of a blob, px.
        glare: Multiple of the usual area above which a blob is a reflection and stays whole.
        out: (B, 3) centroid x, y, px, and area, px, of every blob.

    Returns:
        The new number of blobs.
    """
    most = len(out)
    half = max(1, int(0.62 * math.sqrt(usual / math.pi) + 0.5))
    if half > WIDEST:
        return blobs
    least = FULL * (bright - dark) * min((2.0 * half + 1.0) ** 2, 0.8 * usual)
    total = blobs
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
        start = total
        k = first[b]
        while k >= 0:
            i = run[0, k]
            for j in range(run[1, k], run[2, k]):
                light = _light_around(image, dark, i, j, half)
                if light < least or total == most:
                    continue
                summit = True
                for di in range(-1, 2):
                    for dj in range(-1, 2):
                        if summit and (di or dj):
                            other = _light_around(image, dark, i + di, j + dj, half)
                            later = di > 0 or (di == 0 and dj > 0)
                            summit = light > other or (later and light == other)
                if summit:
                    out[total, 0], out[total, 1], out[total, 2] = j, i, 0.0
                    total += 1
            k = chain[k]
        if total - start < 2:
            total = start
            continue
        sums = np.zeros((total - start, 4))
        k = first[b]
        while k >= 0:
            i = run[0, k]
            for j in range(run[1, k], run[2, k]):
                best, mine = np.inf, 0
                for s in range(start, total):
                    square = (out[s, 0] - j) ** 2 + (out[s, 1] - i) ** 2
                    if square < best:
                        best, mine = square, s - start
                w = image[i, j] - dark
                sums[mine, 0] += w * j
                sums[mine, 1] += w * i
                sums[mine, 2] += 1.0
                sums[mine, 3] += w
            k = chain[k]
        for s in range(total - start):
            out[start + s, 0] = sums[s, 0] / sums[s, 3]
            out[start + s, 1] = sums[s, 1] / sums[s, 3]
            out[start + s, 2] = sums[s, 2]
        out[b, 2] = 0.0
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def find_blobs(image, glare, run, out):  # type: ignore[no-untyped-def]
    """Find the bright blobs of a frame.

    Args:
        image: (H, W) grey levels.
        glare: Multiple of the usual area above which a blob is a reflection.
        run: (4, R), room for the runs of bright pixels.
        out: (R, 3), set to x, y, px, and area, px, of every blob.

    Returns:
        The number of blobs, and (B,) whether each may be a pin.
    """
    threshold, dark, bright = find_levels(image)
    if threshold > 255:
        return 0, np.zeros(0, np.bool_)
    count, blobs = find_runs(image, threshold, run)
    blobs = min(blobs, len(out))
    measure_blobs(image, dark, dark == 0.0 and bright == 255.0, run, count, blobs, out)
    usual = usual_area(out, blobs)
    blobs = split_merged(image, dark, bright, run, count, blobs, usual, glare, out)
    usable = np.zeros(blobs, np.bool_)
    for b in range(blobs):
        usable[b] = SPECK * usual < out[b, 2] < glare * usual
    return blobs, usable
