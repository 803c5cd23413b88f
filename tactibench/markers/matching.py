"""Match of all pins of one frame to its blobs, compiled.

First guesses are grown, doubtful matches are taken back, and pins that are not seen are predicted.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from tactibench.markers.growth import (
    GATE,
    LEAST,
    file_blobs,
    grow_matches,
    nearest_blob,
    predict_place,
)

FIRST = 0.36
"""A first guess lies within this many pitches of the place at rest."""
STEEPEST = 0.25
"""Neighbours move alike when their displacements differ by less than this share of their distance.
Between pins of real plate presses 0.35 is passed by one pair in a thousand."""
PARTS, STARTS = 3, 24
"""Numbers of starts that are tried: parts that hardly moved, then patches at the border."""
FARTHEST = 1.3
"""A pin of the border is sought within this many pitches of its place at rest."""
WIDE = 0.8
"""A pin that is left over takes a blob that is left over within this many local pitches."""
ENOUGH = 0.97
"""A match of this share of the pins ends the search: a match that is one pin off loses a whole side
of the layout."""
AT_HOME = 0.5
"""A border that moved by less than this many pitches on average is not one pin off."""
DOUBTS = 3
"""Most rounds in which doubtful matches are taken back and grown again; fewer when none is
doubtful."""


@njit(cache=True, nogil=True, error_model="numpy")
def _guess_matches(layout, blobs, owner, grid, which):  # type: ignore[no-untyped-def]
    """Set which (P,) to the nearest blob of each pin, -1 where another pin is nearer to it."""
    square = np.empty(len(layout.rest))
    taker = np.full(len(blobs), -1)
    for p in range(len(layout.rest)):
        b, square[p] = nearest_blob(
            layout.rest[p, 0], layout.rest[p, 1], FIRST * layout.pitch[p], blobs, owner, grid
        )
        which[p] = b
        if b >= 0:
            other = taker[b]
            if other >= 0 and square[other] <= square[p]:
                which[p] = -1
            else:
                if other >= 0:
                    which[other] = -1
                taker[b] = p


@njit(cache=True, nogil=True, error_model="numpy")
def _find_parts(layout, blobs, which, part):  # type: ignore[no-untyped-def]
    """Find the connected parts of the layout in which neighbours move alike.

    A pin is in a part when at least three quarters of its guessed neighbours, and four, move like
    it.

    Args:
        layout: Neighbours of pins at rest.
        blobs: (B, 2 or more), x and y first, px.
        which: (P,) guessed blob of every pin, -1 for none.
        part: (P,), set to the number of each pin's part, -1 for a pin in no part.

    Returns:
        The numbers of pins of the parts.
    """
    pins, many = layout.near.shape
    sound = np.zeros(pins, np.bool_)
    alike = np.zeros((pins, many), np.bool_)
    for p in range(pins):
        if which[p] < 0:
            continue
        guessed, same = 0, 0
        u = blobs[which[p], 0] - layout.rest[p, 0]
        v = blobs[which[p], 1] - layout.rest[p, 1]
        for k in range(many):
            q = layout.near[p, k]
            if which[q] < 0:
                continue
            guessed += 1
            du = blobs[which[q], 0] - layout.rest[q, 0] - u
            dv = blobs[which[q], 1] - layout.rest[q, 1] - v
            dx, dy = layout.rest[q, 0] - layout.rest[p, 0], layout.rest[q, 1] - layout.rest[p, 1]
            if du * du + dv * dv < STEEPEST * STEEPEST * (dx * dx + dy * dy):
                alike[p, k] = True
                same += 1
        sound[p] = same >= min(4, many) and 4 * same >= 3 * guessed
    part[:] = -1
    sizes = np.zeros(pins, np.int64)
    stack = np.empty(pins, np.int64)
    parts = 0
    for start in range(pins):
        if part[start] >= 0 or not sound[start]:
            continue
        stack[0], height = start, 1
        part[start] = parts
        while height:
            height -= 1
            p = stack[height]
            sizes[parts] += 1
            for k in range(many):
                q = layout.near[p, k]
                if alike[p, k] and sound[q] and part[q] < 0:
                    part[q] = parts
                    stack[height] = q
                    height += 1
        parts += 1
    return sizes[:parts]


@njit(cache=True, nogil=True, error_model="numpy")
def _unmatch_doubtful(layout, which, owner, place):  # type: ignore[no-untyped-def]
    """Take back matches that lie far from where their neighbours predict them; return how many."""
    out = np.empty(3)
    off = np.zeros(len(layout.rest))
    for p in range(len(layout.rest)):
        if which[p] >= 0 and predict_place(p, layout, which, place, out) >= LEAST:
            away = np.sqrt((place[p, 0] - out[0]) ** 2 + (place[p, 1] - out[1]) ** 2)
            off[p] = away / (out[2] * layout.pitch[p])
    count = 0
    for p in range(len(layout.rest)):
        if off[p] <= GATE:
            continue
        worst = True
        for k in range(layout.near.shape[1]):
            worst &= off[layout.near[p, k]] <= off[p]
        if worst:
            owner[which[p]] = -1
            which[p] = -1
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _border_starts(layout, blobs, owner, grid, pin, taken):  # type: ignore[no-untyped-def]
    """Find starts at the border, surest first.

    A start is a pin of the border with any blob near it. It is the surer, the more of the pin's
    neighbours find a blob when they are displaced as much, the nearer these blobs are, and the
    smaller the displacement is.

    Args:
        layout: Neighbours of pins at rest.
        blobs: (B, 2 or more), x and y first, px.
        owner: (B,) pin of every blob, -1 for none.
        grid: The blobs as ``file_blobs`` chained them.
        pin: (S,), set to the pins of the starts.
        taken: (S,), set to the blobs of these pins.

    Returns:
        The number of starts, at most S.
    """
    worth = np.empty(len(pin))
    count = 0
    for p in layout.border:
        for b in range(len(blobs)):
            u, v = blobs[b, 0] - layout.rest[p, 0], blobs[b, 1] - layout.rest[p, 1]
            if not (owner[b] < 0 and u * u + v * v < (FARTHEST * layout.pitch[p]) ** 2):
                continue
            support = 0.0
            for k in range(layout.near.shape[1]):
                q = layout.near[p, k]
                reach = FIRST * layout.pitch[q]
                blob, square = nearest_blob(
                    layout.rest[q, 0] + u, layout.rest[q, 1] + v, reach, blobs, owner, grid
                )
                if blob >= 0:
                    support += 1.0 - square / (reach * reach)
            support -= np.sqrt(u * u + v * v) / layout.pitch[p]
            if count == len(pin) and support <= worth[count - 1]:
                continue
            k = min(count, len(pin) - 1)
            while k > 0 and worth[k - 1] < support:
                worth[k], pin[k], taken[k] = worth[k - 1], pin[k - 1], taken[k - 1]
                k -= 1
            worth[k], pin[k], taken[k] = support, p, b
            count = min(count + 1, len(pin))
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def _grow(layout, blobs, which, owner, place, grid):  # type: ignore[no-untyped-def]
    """Grow the matches, take back doubtful ones and grow again; return the number of matches."""
    for p in range(len(layout.rest)):
        if which[p] >= 0:
            owner[which[p]] = p
            place[p, 0], place[p, 1] = blobs[which[p], 0], blobs[which[p], 1]
    for _ in range(DOUBTS):
        matched = grow_matches(layout, blobs, which, owner, place, grid)
        doubtful = _unmatch_doubtful(layout, which, owner, place)
        matched -= doubtful
        if not doubtful:
            break
    return matched


@njit(cache=True, nogil=True, error_model="numpy")
def _match_leftovers(layout, blobs, which, owner, place, grid):  # type: ignore[no-untyped-def]
    """Match the pins and blobs that are left over, nearest first; return the number of matches.

    Where the field is steep, neighbours predict badly, but the nearest blob is still the likeliest.
    """
    out = np.empty(3)
    given = 0
    while True:
        best, taker, taken = WIDE, -1, -1
        for p in range(len(layout.rest)):
            if which[p] >= 0 or predict_place(p, layout, which, place, out) < LEAST - 1:
                continue
            local = out[2] * layout.pitch[p]
            b, square = nearest_blob(out[0], out[1], best * local, blobs, owner, grid)
            if b >= 0:
                best, taker, taken = np.sqrt(square) / local, p, b
        if taker < 0:
            return given
        which[taker], owner[taken] = taken, taker
        place[taker, 0], place[taker, 1] = blobs[taken, 0], blobs[taken, 1]
        given += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _border_shift(layout, which, place):  # type: ignore[no-untyped-def]
    """Return the mean displacement of the border's matched pins, pitches."""
    total, count = 0.0, 0
    for p in layout.border:
        if which[p] >= 0:
            u, v = place[p, 0] - layout.rest[p, 0], place[p, 1] - layout.rest[p, 1]
            total += np.sqrt(u * u + v * v) / layout.pitch[p]
            count += 1
    return total / max(count, 1)


@njit(cache=True, nogil=True, error_model="numpy")
def match_pins(layout, blobs, count, usable, shape, which, place):  # type: ignore[no-untyped-def]
    """Match the pins of a layout to the blobs of a frame.

    Starts are tried until one leads to a match of nearly all pins (or blobs) with a border that
    hardly moved. Otherwise the start with most matches wins, and of several the one whose border
    moved least.

    Args:
        layout: Neighbours of pins at rest.
        blobs: (B, 2 or more), x and y first, px, of which the first ``count`` are set.
        count: Number of blobs.
        usable: (B,) whether a blob may be a pin.
        shape: Height and width of the frame, px.
        which: (P,), set to the blob of every pin, -1 where it is not seen.
        place: (P, 2), set to the place of every seen pin, px.

    Returns:
        The number of matched pins.
    """
    pins = len(layout.rest)
    cell = max(np.median(layout.pitch), 2.0)
    blobs = blobs[:count]
    grid = file_blobs(blobs, count, usable, cell, shape)
    most = min(pins, np.sum(usable[:count]))
    owner = np.full(count, -1)
    guess, part = np.empty(pins, np.int64), np.empty(pins, np.int64)
    _guess_matches(layout, blobs, owner, grid, guess)
    sizes = _find_parts(layout, blobs, guess, part)
    mine, spot = np.empty(pins, np.int64), np.empty((pins, 2))
    pin, taken = np.empty(STARTS, np.int64), np.empty(STARTS, np.int64)
    starts = -1
    which[:] = -1
    best, best_far = 0, np.inf
    for trial in range(PARTS + STARTS):
        mine[:] = -1
        owner[:] = -1
        if trial < PARTS:
            if trial >= len(sizes):
                continue
            largest = np.argmax(sizes)
            if sizes[largest] < min(LEAST, pins):
                continue
            sizes[largest] = 0
            for p in range(pins):
                if part[p] == largest:
                    mine[p] = guess[p]
        else:
            if starts < 0:
                starts = _border_starts(layout, blobs, owner, grid, pin, taken)
            k = trial - PARTS
            if k >= starts:
                break
            p, b = pin[k], taken[k]
            if which[p] == b and best > 0.5 * most:
                continue  # the best match has this pair already
            u, v = blobs[b, 0] - layout.rest[p, 0], blobs[b, 1] - layout.rest[p, 1]
            mine[p], owner[b] = b, p
            for k in range(layout.near.shape[1]):
                q = layout.near[p, k]
                blob, _ = nearest_blob(
                    layout.rest[q, 0] + u,
                    layout.rest[q, 1] + v,
                    FIRST * layout.pitch[q],
                    blobs,
                    owner,
                    grid,
                )
                if blob >= 0:
                    mine[q], owner[blob] = blob, q
        matched = _grow(layout, blobs, mine, owner, spot, grid)
        far = _border_shift(layout, mine, spot)
        if matched > best or (matched == best and far < best_far):
            best, best_far = matched, far
            which[:] = mine
            place[:] = spot
        if best >= ENOUGH * most and best_far < AT_HOME:
            break
    if best < pins:
        owner[:] = -1
        for p in range(pins):
            if which[p] >= 0:
                owner[which[p]] = p
        best += _match_leftovers(layout, blobs, which, owner, place, grid)
    return best


@njit(cache=True, nogil=True, error_model="numpy")
def fill_unseen(layout, which, place):  # type: ignore[no-untyped-def]
    """Predict the place (P, 2) px of pins with which < 0, those with most placed neighbours first.

    Where no pin is matched, all stand at rest.
    """
    placed = which.copy()
    out = np.empty(3)
    left = 0
    for p in range(len(layout.rest)):
        if which[p] < 0:
            left += 1
    if left == len(layout.rest):
        place[:] = layout.rest
        return
    for need in range(layout.near.shape[1], -1, -1):
        again = left > 0
        while again:
            again = False
            for p in range(len(layout.rest)):
                if placed[p] >= 0:
                    continue
                n = 0
                for k in range(layout.near.shape[1]):
                    n += placed[layout.near[p, k]] >= 0
                if n >= need:
                    predict_place(p, layout, placed, place, out)
                    place[p, 0], place[p, 1] = out[0], out[1]
                    placed[p] = 0
                    left -= 1
                    again = left > 0
        if left == 0:
            return
