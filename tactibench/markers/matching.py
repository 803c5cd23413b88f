"""Match of all pins of one frame to its blobs, compiled.

First guesses are grown, doubtful matches are taken back, and pins that are not seen are predicted.

A match grows from certain pins to those around them. The field of displacements is smooth, but can
move pins by more than a pitch. So a pin is not sought where it was, but where its matched
neighbours predict it: the affine map through them (least squares) gives a place and the local
stretch. The pin whose blob lies nearest to its place, in local pitches, is matched next (best
first, with a heap). Each start is a connected part of the layout in which nearest blobs move alike;
the part that leads to most matches wins.
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
            for p in range(pins):
                which[p], place[p, 0], place[p, 1] = mine[p], spot[p, 0], spot[p, 1]
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
