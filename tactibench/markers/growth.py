"""Growth of a match of blobs to pins, compiled: from certain pins to those around them.

The field of displacements is smooth, but can move pins by more than a pitch. So a pin is not sought
where it was, but where its matched neighbours predict it: the affine map through them (least
squares) gives a place and the local stretch. The pin whose blob lies nearest to its place, in local
pitches, is matched next (best first, with a heap). Each start is a connected part of the layout in
which nearest blobs move alike; the part that leads to most matches wins.
"""

from __future__ import annotations

import numpy as np
from numba import njit

GATE = 0.45
"""A blob fits a pin when it is nearer to the predicted place than this, in local pitches."""
LEAST = 4
"""Matched neighbours needed for a place to be predicted."""
ALONE = 0.6
"""Penalty in the order of matching, pitches: a pin with no matched neighbour waits as if its blob
lay this much farther off, others in proportion."""
STRETCH_LOW, STRETCH_HIGH = 0.35, 2.5
"""Limits of the local stretch: what lies beyond them comes from a few noisy neighbours, not from
the skin."""
RIDGE = 0.02
"""Weight of "no slope" against one neighbour: it holds the plane where neighbours are in a line."""


@njit(cache=True, nogil=True, error_model="numpy")
def predict_place(p, layout, which, place, out):  # type: ignore[no-untyped-def]
    """Set out (3,) to x, y, px, and stretch of pin p, by the affine map through its neighbours.

    Args:
        p: Number of the pin.
        layout: Neighbours of pins at rest.
        which: (P,) blob of every pin, -1 where the pin is not matched.
        place: (P, 2) px of matched pins.
        out: (3,), set to x, y and stretch.

    Returns:
        The number of matched neighbours that the prediction rests on.
    """
    n = 0
    sxx, sxy, syy, sx, sy = 0.0, 0.0, 0.0, 0.0, 0.0
    u0, v0, ux, uy, vx, vy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    total, scale = 0.0, 0.0
    for k in range(layout.near.shape[1]):
        q = layout.near[p, k]
        if which[q] < 0:
            continue
        x, y = layout.rest[q, 0] - layout.rest[p, 0], layout.rest[q, 1] - layout.rest[p, 1]
        u, v = place[q, 0] - layout.rest[q, 0], place[q, 1] - layout.rest[q, 1]
        w = 1.0 / (x * x + y * y)
        n += 1
        total += w
        scale += 1.0
        sx += w * x
        sy += w * y
        sxx += w * x * x
        sxy += w * x * y
        syy += w * y * y
        u0 += w * u
        v0 += w * v
        ux += w * u * x
        uy += w * u * y
        vx += w * v * x
        vy += w * v * y
    if n == 0:
        out[0], out[1], out[2] = layout.rest[p, 0], layout.rest[p, 1], 1.0
        return 0
    mx, my, mu, mv = sx / total, sy / total, u0 / total, v0 / total
    a = sxx - total * mx * mx + RIDGE * n  # w r^2 is 1 for each
    b = sxy - total * mx * my
    d = syy - total * my * my + RIDGE * n
    det = a * d - b * b
    e, f = ux - total * mx * mu, uy - total * my * mu
    g, h = vx - total * mx * mv, vy - total * my * mv
    gxx, gxy = (d * e - b * f) / det, (a * f - b * e) / det
    gyx, gyy = (d * g - b * h) / det, (a * h - b * g) / det
    out[0] = layout.rest[p, 0] + mu - gxx * mx - gxy * my
    out[1] = layout.rest[p, 1] + mv - gyx * mx - gyy * my
    out[2] = min(max(np.sqrt(abs((1 + gxx) * (1 + gyy) - gxy * gyx)), STRETCH_LOW), STRETCH_HIGH)
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def file_blobs(blobs, count, usable, cell, shape):  # type: ignore[no-untyped-def]
    """Return the usable blobs, chained by square cells of a frame: the grid of ``nearest_blob``.

    Args:
        blobs: (B, 2 or more), x and y first, px.
        count: Number of blobs.
        usable: (B,) whether a blob may be a pin.
        cell: Side of a cell, px.
        shape: Height and width of the frame, px.

    Returns:
        Side of a cell, columns, rows, the first blob of every cell, and the blob after each blob in
        its cell; -1 for none.
    """
    columns, rows = int(shape[1] / cell) + 1, int(shape[0] / cell) + 1
    head, after = np.full(columns * rows, -1), np.full(count, -1)
    for b in range(count):
        if usable[b]:
            c = min(max(int(blobs[b, 0] / cell), 0), columns - 1)
            r = min(max(int(blobs[b, 1] / cell), 0), rows - 1)
            after[b] = head[r * columns + c]
            head[r * columns + c] = b
    return cell, columns, rows, head, after


@njit(cache=True, nogil=True, error_model="numpy")
def nearest_blob(x, y, reach, blobs, owner, grid):  # type: ignore[no-untyped-def]
    """Return the nearest blob within reach that no pin owns, and its squared distance, px^2.

    Where there is none, these are -1 and the squared reach.

    Args:
        x: Place from which distances are measured, px.
        y: Place from which distances are measured, px.
        reach: Largest distance, px.
        blobs: (B, 2 or more), x and y first, px.
        owner: (B,) pin of every blob, -1 for none.
        grid: The blobs as ``file_blobs`` chained them.
    """
    cell, columns, rows, head, after = grid
    best, blob = reach * reach, -1
    left, right = max(int((x - reach) / cell), 0), min(int((x + reach) / cell), columns - 1)
    top, bottom = max(int((y - reach) / cell), 0), min(int((y + reach) / cell), rows - 1)
    for r in range(top, bottom + 1):
        for c in range(left, right + 1):
            b = head[r * columns + c]
            while b >= 0:
                if owner[b] < 0:
                    square = (blobs[b, 0] - x) ** 2 + (blobs[b, 1] - y) ** 2
                    if square < best:
                        best, blob = square, b
                b = after[b]
    return blob, best


@njit(cache=True, nogil=True, error_model="numpy")
def _push(score, pin, size, new_score, new_pin):  # type: ignore[no-untyped-def]
    k = size
    while k > 0:
        up = (k - 1) // 2
        if score[up] <= new_score:
            break
        score[k], pin[k] = score[up], pin[up]
        k = up
    score[k], pin[k] = new_score, new_pin
    return size + 1


@njit(cache=True, nogil=True, error_model="numpy")
def _pop(score, pin, size):  # type: ignore[no-untyped-def]
    """Move the least entry behind the end of the heap, and return the new size."""
    least_score, least_pin = score[0], pin[0]
    size -= 1
    last_score, last_pin = score[size], pin[size]
    k = 0
    while True:
        down = 2 * k + 1
        if down >= size:
            break
        if down + 1 < size and score[down + 1] < score[down]:
            down += 1
        if last_score <= score[down]:
            break
        score[k], pin[k] = score[down], pin[down]
        k = down
    score[k], pin[k] = last_score, last_pin
    score[size], pin[size] = least_score, least_pin
    return size


@njit(cache=True, nogil=True, error_model="numpy")
def grow_matches(layout, blobs, which, owner, place, grid):  # type: ignore[no-untyped-def]
    """Match further pins, from the matches that ``which`` holds.

    Args:
        layout: Neighbours of pins at rest.
        blobs: (B, 2 or more), x and y first, px.
        which: (P,) blob of every pin, -1 where it is not matched; is updated.
        owner: (B,) pin of every blob, -1 for none; is updated.
        place: (P, 2) px of matched pins; is updated.
        grid: The blobs as ``file_blobs`` chained them.

    Returns:
        The number of matched pins.
    """
    pins, many = layout.near.shape
    score, queue = np.empty(pins + 1), np.empty(pins + 1, np.int64)
    queued = np.zeros(pins, np.bool_)
    seen_from = np.full(pins, -1)  # matched neighbours when last looked at
    now = np.zeros(pins, np.int64)
    out = np.empty(3)
    size, matched, need = 0, 0, min(LEAST, many)
    for p in range(pins):
        if which[p] >= 0:
            matched += 1
            for k in range(layout.back.shape[1]):
                if layout.back[p, k] < 0:
                    break
                now[layout.back[p, k]] += 1
    for p in range(pins):
        if which[p] < 0 and now[p] >= need:
            size = _push(score, queue, size, ALONE * (1.0 - now[p] / many), p)
            queued[p] = True
    while size > 0:
        size = _pop(score, queue, size)
        p = queue[size]
        fresh = seen_from[p] == now[p]
        seen_from[p] = now[p]
        predict_place(p, layout, which, place, out)
        local = out[2] * layout.pitch[p]
        b, square = nearest_blob(out[0], out[1], GATE * local, blobs, owner, grid)
        if b < 0:
            queued[p] = False  # until another neighbour is matched
            continue
        off = np.sqrt(square) / local + ALONE * (1.0 - now[p] / many)
        if not fresh and size > 0 and off > score[0]:
            size = _push(score, queue, size, off, p)
            continue
        queued[p] = False
        which[p], owner[b] = b, p
        place[p, 0], place[p, 1] = blobs[b, 0], blobs[b, 1]
        matched += 1
        for k in range(layout.back.shape[1]):
            q = layout.back[p, k]
            if q < 0:
                break
            now[q] += 1
            if which[q] < 0 and not queued[q] and now[q] >= need:
                size = _push(score, queue, size, ALONE * (1.0 - now[q] / many), q)
                queued[q] = True
    return matched
