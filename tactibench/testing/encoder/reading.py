"""Contacts come back from clean maps."""

from __future__ import annotations

import numpy as np

from tactibench.contacts import Contacts, Grid
from tactibench.testing.encoder.subject import (
    DEEP,
    HALF_WIDTH,
    SHALLOW,
    EncoderSubject,
    errors,
    single,
    words,
)
from tactibench.testing.property import require

DEPTH_SLACK = 0.05
"""mm by which a depth may be off where contacts are near each other or the border."""


def empty(subject: EncoderSubject) -> None:
    """No contacts give empty maps, and empty maps no contacts, alone and in a batch."""
    encoder, shape = subject.encoder, subject.grid.shape
    maps = encoder.encode(Contacts.none(), subject.grid)
    wanted = (encoder.channels, *shape)
    require(maps.shape == wanted, f"maps of shape {maps.shape}, expected {wanted}")
    require(not (subject.heat and maps[0].any()), "the first map is not 0 where nothing touches")
    require(len(encoder.decode(maps, subject.grid)) == 0, "a contact was read from empty maps")
    for count in (0, 1, 70):
        read = [len(one) for one in subject.decoded(np.repeat(maps[None], count, axis=0))]
        require(read == [0] * count, f"a batch of {count} empty maps was read as {read}")
    for value in (0.04, 0.5, 1.0) if subject.heat else ():
        flat = np.full(wanted, value, np.float32)
        count = len(encoder.decode(flat, subject.grid))
        require(not count, f"{count} contacts were read from maps that are {value} everywhere")


def round_trip(subject: EncoderSubject) -> None:
    """One contact comes back alone and within the declared tolerance; maps are float32 in 0..1."""
    rng = np.random.default_rng(2)
    corners = [
        Contacts.truth([[x, y]], [depth])
        for x in (-HALF_WIDTH, HALF_WIDTH)
        for y in (-HALF_WIDTH, 0.0)
        for depth in (SHALLOW, DEEP)
    ]
    cells = [Contacts.truth([subject.grid.xy(row, row)], [2.0]) for row in (30, 30.5)]
    encoder = subject.encoder
    for truth in [*corners, *cells, *(single(rng) for _ in range(40))]:
        maps = encoder.encode(truth, subject.grid)
        wanted = (encoder.channels, *subject.grid.shape)
        require(maps.dtype == np.float32, f"maps of {maps.dtype}, expected float32")
        require(maps.shape == wanted, f"maps of shape {maps.shape}, expected {wanted}")
        low, high = float(maps.min()), float(maps.max())
        require(not subject.heat or (low >= 0 and high <= 1), f"maps from {low:g} to {high:g}")
        found = encoder.decode(maps, subject.grid)
        require(len(found) == 1, f"{words(truth)} was read as {len(found)} contacts")
        worst = max(errors(found, truth))
        require(
            worst <= encoder.tolerance,
            f"{words(truth)} came back off by {worst:.3g} mm, tolerance {encoder.tolerance:g}",
        )


def border(subject: EncoderSubject) -> None:
    """A contact at the grid's edge, up to 0.4 cells outside it, is found within half a cell."""
    grid, encoder = subject.grid, subject.encoder
    allowed = max(encoder.tolerance, 0.5 * grid.pitch)
    for beyond in (0.0, 0.375, -0.825, -2.75):
        x, _ = grid.xy(0, -beyond)
        _, low = grid.xy(grid.shape[0] - 1 + beyond, 0)
        for y in (3.3, low):
            truth = Contacts.truth([[x, y]], [2.5])
            found = encoder.decode(encoder.encode(truth, grid), grid)
            require(len(found) == 1, f"{words(truth)} was read as {len(found)} contacts")
            position, depth = errors(found, truth)
            require(position <= allowed, f"{words(truth)} came back off by {position:.3g} mm")
            require(depth <= DEPTH_SLACK, f"the depth of {words(truth)} is off by {depth:.3g} mm")


def permutation(subject: EncoderSubject) -> None:
    """The order of the contacts changes no map, and all of them come back."""
    subject.must_show_several()
    encoder, grid = subject.encoder, subject.grid
    xy, depth = np.array([[-5.0, 4], [4.3, 4.9], [0.2, -5.1]]), np.array([1.0, 3.0, 5.5])
    far = Contacts.truth(xy, depth), Contacts.truth(xy[[2, 0, 1]], depth[[2, 0, 1]])
    near = Contacts.truth([[-1, 0], [1, 0]], [1, 5]), Contacts.truth([[1, 0], [-1, 0]], [5, 1])
    for one, other in (far, near):
        same = np.array_equal(encoder.encode(one, grid), encoder.encode(other, grid))
        require(same, f"the maps of {words(one)} depend on their order")
    found = encoder.decode(encoder.encode(far[0], grid), grid)
    require(len(found) == 3, f"{words(far[0])} were read as {len(found)} contacts")
    worst = max(errors(found, far[0]))
    require(worst <= encoder.tolerance, f"{words(far[0])} came back off by {worst:.3g} mm")


def shift(subject: EncoderSubject) -> None:
    """Moving the maps by whole cells moves the contact by whole pitches and keeps its depth."""
    rng = np.random.default_rng(6)
    encoder, grid = subject.encoder, subject.grid
    for _ in range(15):
        truth = Contacts.truth(rng.uniform(-5, 5, (1, 2)), rng.uniform(SHALLOW, DEEP, 1))
        right, down = rng.integers(-6, 7, 2).tolist()
        maps = encoder.encode(truth, grid)
        here = encoder.decode(maps, grid)
        there = encoder.decode(np.roll(maps, (down, right), axis=(1, 2)), grid)
        require(len(here) == len(there), f"{words(truth)} moved is {len(there)} contacts")
        moved = np.abs(there.xy - here.xy - grid.pitch * np.array([right, down])).max()
        require(
            moved <= 1e-6, f"{words(truth)} moved by {right}, {down} cells is off by {moved:.3g}"
        )
        deeper = np.abs(there.depth - here.depth).max()
        require(deeper <= 1e-6, f"the depth of {words(truth)} changed by {deeper:.3g} mm")


def refine(subject: EncoderSubject) -> None:
    """On clean maps positions are read fifty times more finely than cells alone would allow."""
    rng = np.random.default_rng(3)
    lists = [single(rng) for _ in range(200)]
    found = subject.decoded(subject.encoded(lists))
    require(all(map(len, found)), "a contact was not read")
    away = [f.xy[0] - t.xy[0] for f, t in zip(found, lists, strict=True)]
    rms, cells = float(np.sqrt(np.mean(np.square(away)))), subject.grid.pitch / np.sqrt(12)
    require(rms < 0.02 * cells, f"rms error {rms:.3g} mm; that of cells is {cells:.3g} mm")


def close_pair(subject: EncoderSubject) -> None:
    """Pairs as close as the declared separation are two, each within half a cell, at any depths."""
    subject.must_show_several()
    rng = np.random.default_rng(5)
    encoder, allowed = subject.encoder, max(subject.encoder.tolerance, 0.5 * subject.grid.pitch)
    for further in (0.0, 0.5, 1.5):
        distance = encoder.separation + further
        require(np.isfinite(distance), "separation is not finite, but several contacts are shown")
        lists = [_pair(rng, distance, [SHALLOW, DEEP]) for _ in range(100)]
        lists += [_pair(rng, distance, rng.uniform(SHALLOW, DEEP, 2)) for _ in range(150)]
        found = subject.decoded(subject.encoded(lists))
        for one, truth in zip(found, lists, strict=True):
            require(len(one) == 2, f"{words(truth)} were read as {len(one)} contacts")
            position, depth = errors(one, truth)
            require(position <= allowed, f"{words(truth)} came back off by {position:.3g} mm")
            require(
                depth <= max(encoder.tolerance, DEPTH_SLACK),
                f"the depths of {words(truth)} came back off by {depth:.3g} mm",
            )


def several(subject: EncoderSubject) -> None:
    """Three contacts 8 mm apart, as the triple indenter makes them, come back finely."""
    subject.must_show_several()
    rng = np.random.default_rng(9)
    lists = []
    for _ in range(60):
        turn = rng.uniform(0, 2 * np.pi) + np.arange(3) * 2 * np.pi / 3
        xy = 8 / np.sqrt(3) * np.column_stack([np.cos(turn), np.sin(turn)])
        places = xy + rng.uniform(-1.5, 1.5, 2)
        lists.append(Contacts.truth(places, rng.uniform(SHALLOW, DEEP, 3)))
    tolerance = subject.encoder.tolerance
    for one, truth in zip(subject.decoded(subject.encoded(lists)), lists, strict=True):
        require(len(one) == 3, f"{words(truth)} were read as {len(one)} contacts")
        position, depth = errors(one, truth)
        require(
            position <= max(tolerance, 0.05) and depth <= max(tolerance, 0.01),
            f"{words(truth)} came back off by {position:.3g} mm, their depths by {depth:.3g} mm",
        )


def another_grid(subject: EncoderSubject) -> None:
    """Rows, columns, origin and pitch of the maps are those of any grid that is asked for."""
    grid, encoder = Grid((40, 70), (-10.0, -3.0), 0.3), subject.encoder
    truth = Contacts.truth([[2.34, 5.43]], [4.0])
    maps = encoder.encode(truth, grid)
    require(maps.shape[1:] == grid.shape, f"maps of shape {maps.shape} for {grid.shape} cells")
    found = encoder.decode(maps, grid)
    require(len(found) == 1, f"{words(truth)} was read as {len(found)} contacts")
    worst = max(errors(found, truth))
    require(worst <= encoder.tolerance, f"{words(truth)} came back off by {worst:.3g} mm")


def _pair(rng: np.random.Generator, distance: float, depth: object) -> Contacts:
    turn = rng.uniform(0, 2 * np.pi)
    half = 0.5 * distance * np.array([np.cos(turn), np.sin(turn)])
    centre = rng.uniform(-3, 3, 2)
    return Contacts.truth(np.array([centre - half, centre + half]), np.asarray(depth, np.float64))
