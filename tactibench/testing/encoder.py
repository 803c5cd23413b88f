"""The properties of an encoder: every public function is a property and gives it its name."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tactibench.contacts import Contacts, Grid
from tactibench.errors import UserError
from tactibench.plugins import Encoder
from tactibench.testing.subjects import (
    EncoderSubject,
    Failed,
    NotApplicable,
    check_parameters,
    difference,
    must_refuse,
    require,
)

NUMBERS = ("channels", "separation", "tolerance")
"""Attributes of an encoder that must be numbers."""
NOISE = 0.02
"""Standard deviation of the noise that a trained network leaves on its maps."""
HALF_WIDTH = 6.4
"""Largest x and y of contacts, either way, mm, as in the experiments."""
SHALLOW, DEEP = 0.5, 6.0
"""Range of depths, mm."""
DEPTH_SLACK = 0.05
"""Largest error of a depth, mm, where contacts are near each other or near the border."""


def target(subject: EncoderSubject) -> None:
    """The class behind the spec loads, inherits from tactibench.Encoder, builds, and has limits."""
    encoder = subject.encoder
    missing = [
        name for name in NUMBERS if not isinstance(getattr(encoder, name, None), int | float)
    ]
    require(not missing, f"it has no {', '.join(missing)}")
    require(encoder.channels >= 1, f"channels is {encoder.channels}")
    require(encoder.tolerance > 0, f"tolerance is {encoder.tolerance} mm; it must be positive")
    require(encoder.separation > 0, f"separation is {encoder.separation} mm; it must be positive")


def parameters(subject: EncoderSubject) -> None:
    """An encoder builds with every bound and choice of a parameter, or refuses it in words."""
    check_parameters(subject.spec, subject.values, subject.build)


def empty(subject: EncoderSubject) -> None:
    """No contacts give empty maps, and empty maps no contacts, alone and in a batch."""
    encoder, shape = subject.encoder, subject.grid.shape
    maps = encoder.encode(Contacts.none(), subject.grid)
    wanted = (encoder.channels, *shape)
    require(maps.shape == wanted, f"maps of shape {maps.shape}, expected {wanted}")
    require(not (subject.is_heat and maps[0].any()), "the first map is not 0 where nothing touches")
    require(len(encoder.decode(maps, subject.grid)) == 0, "a contact was read from empty maps")
    for count in (0, 1, 70):
        read = [len(contacts) for contacts in subject.decode(np.repeat(maps[None], count, axis=0))]
        require(read == [0] * count, f"a batch of {count} empty maps was read as {read}")
    for value in (0.04, 0.5, 1.0) if subject.is_heat else ():
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
    for truth in [*corners, *cells, *(_random_contact(rng) for _ in range(40))]:
        maps = encoder.encode(truth, subject.grid)
        wanted = (encoder.channels, *subject.grid.shape)
        require(maps.dtype == np.float32, f"maps of {maps.dtype}, expected float32")
        require(maps.shape == wanted, f"maps of shape {maps.shape}, expected {wanted}")
        low, high = float(maps.min()), float(maps.max())
        require(not subject.is_heat or (low >= 0 and high <= 1), f"maps from {low:g} to {high:g}")
        decoded = encoder.decode(maps, subject.grid)
        require(len(decoded) == 1, f"{_label(truth)} was read as {len(decoded)} contacts")
        worst = max(_largest_errors(decoded, truth))
        require(
            worst <= encoder.tolerance,
            f"{_label(truth)} came back off by {worst:.3g} mm, tolerance {encoder.tolerance:g}",
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
            position, depth = _read_back(encoder, truth, grid)
            require(position <= allowed, f"{_label(truth)} came back off by {position:.3g} mm")
            require(depth <= DEPTH_SLACK, f"the depth of {_label(truth)} is off by {depth:.3g} mm")


def permutation(subject: EncoderSubject) -> None:
    """The order of the contacts changes no map, and all of them come back."""
    subject.skip_unless_several()
    encoder, grid = subject.encoder, subject.grid
    xy, depth = np.array([[-5.0, 4], [4.3, 4.9], [0.2, -5.1]]), np.array([1.0, 3.0, 5.5])
    far = Contacts.truth(xy, depth), Contacts.truth(xy[[2, 0, 1]], depth[[2, 0, 1]])
    near = Contacts.truth([[-1, 0], [1, 0]], [1, 5]), Contacts.truth([[1, 0], [-1, 0]], [5, 1])
    for contacts, reordered in (far, near):
        same = np.array_equal(encoder.encode(contacts, grid), encoder.encode(reordered, grid))
        require(same, f"the maps of {_label(contacts)} depend on their order")
    worst = max(_read_back(encoder, far[0], grid))
    require(worst <= encoder.tolerance, f"{_label(far[0])} came back off by {worst:.3g} mm")


def noise(subject: EncoderSubject) -> None:
    """White noise of 0.02 moves the best contact little, and its depth by no more than 0.36 mm."""
    if not subject.is_heat:
        raise NotApplicable(f"its maps, of kind {subject.spec.kind!r}, are no heat")
    rng = np.random.default_rng(4)
    lists = [_random_contact(rng, shallowest=2.0) for _ in range(200)]
    maps = subject.encode(lists)
    maps = maps + NOISE * rng.standard_normal(maps.shape, dtype=np.float32)
    best = [contacts.top(1) for contacts in subject.decode(maps)]
    depth = [_largest_errors(f, t)[1] for f, t in zip(best, lists, strict=True)]
    away = np.array([f.xy[0] - t.xy[0] for f, t in zip(best, lists, strict=True)])
    rms = float(np.sqrt(np.mean(np.square(away)))) / subject.grid.pitch
    require(rms < subject.noise_cells, f"rms {rms:.3g} cells, at most {subject.noise_cells:g}")
    off, most = float(np.sqrt(np.mean(np.square(depth)))), 3 * NOISE * DEEP
    require(off < most, f"the depth is off by {off:.3g} mm rms, at most {most:.2g} mm")


def close_pair(subject: EncoderSubject) -> None:
    """Pairs as close as the declared separation are two, each within half a cell, at any depths."""
    subject.skip_unless_several()
    rng = np.random.default_rng(5)
    encoder, allowed = subject.encoder, max(subject.encoder.tolerance, 0.5 * subject.grid.pitch)
    for further in (0.0, 0.5, 1.5):
        distance = encoder.separation + further
        require(np.isfinite(distance), "separation is not finite, but several contacts are shown")
        lists = [_random_pair(rng, distance, [SHALLOW, DEEP]) for _ in range(100)]
        lists += [_random_pair(rng, distance, rng.uniform(SHALLOW, DEEP, 2)) for _ in range(150)]
        decoded = subject.decode(subject.encode(lists))
        for contacts, truth in zip(decoded, lists, strict=True):
            require(len(contacts) == 2, f"{_label(truth)} were read as {len(contacts)} contacts")
            position, depth = _largest_errors(contacts, truth)
            require(position <= allowed, f"{_label(truth)} came back off by {position:.3g} mm")
            require(
                depth <= max(encoder.tolerance, DEPTH_SLACK),
                f"the depths of {_label(truth)} came back off by {depth:.3g} mm",
            )


def pure(subject: EncoderSubject) -> None:
    """Maps are left as they are, may be read-only, and are read alike in a batch and alone."""
    rng = np.random.default_rng(7)
    lists = [_random_contact(rng) for _ in range(70)]
    maps = subject.encode(lists)
    batch = subject.encoder.encode_batch(lists, subject.grid)
    require(np.array_equal(batch, maps), "encode_batch differs from encode")
    maps = maps + 0.01 * rng.random(maps.shape, dtype=np.float32)
    before = maps.copy()
    together = subject.decode(maps)
    alone = [subject.encoder.decode(single, subject.grid) for single in maps]
    require(np.array_equal(maps, before), "decoding changed the maps")
    gap = difference(alone, together)
    require(gap <= 1e-9, f"alone and in a batch, contacts differ by {gap:.3g}")
    maps.setflags(write=False)
    subject.decode(maps)


def scores(subject: EncoderSubject) -> None:
    """Scores lie in 0..1 and fall with the heat; noise is read as a bounded number of contacts."""
    encoder, grid = subject.encoder, subject.grid
    maps = encoder.encode(Contacts.truth([[1.2, -2.1]], [DEEP]), grid)
    full = encoder.decode(1.05 * maps, grid)
    require(len(full) and full.score[0] == 1.0, f"maps 5 % above 1 have the scores {full.score}")
    faint = [encoder.decode(np.float32(share) * maps, grid).score for share in (1.0, 0.8, 0.5)]
    require(all(map(len, faint)), "at half its heat, a contact of 6 mm was not read")
    best = [float(score[0]) for score in faint]
    require(all(a > b for a, b in pairwise(best)), f"of heat 1, 0.8 and 0.5 scores are {best}")
    noisy = np.random.default_rng(8).random((20, *maps.shape))
    low, high = grid.xy(0, 0) - 2.5, grid.xy(grid.shape[0] - 1, grid.shape[1] - 1) + 2.5
    for decoded in subject.decode(noisy):
        require(
            len(decoded) <= subject.most_contacts, f"{len(decoded)} contacts were read from noise"
        )
        inside = ((decoded.xy >= low) & (decoded.xy <= high)).all()
        require(inside, "a contact was read more than 2.5 mm outside the grid")


def refusals(subject: EncoderSubject) -> None:
    """Maps with NaN, infinity or another shape are refused, and two contacts where one is shown."""
    encoder, (rows, columns) = subject.encoder, subject.grid.shape
    for bad in (np.nan, np.inf, -np.inf):
        maps = np.zeros((encoder.channels, rows, columns), np.float32)
        maps[-1, 5, 6] = bad
        with must_refuse(f"a map that holds {bad}"):
            encoder.decode(maps, subject.grid)
        with must_refuse(f"a batch that holds {bad}"):
            subject.decode(maps[None])
    for wrong in (
        (rows, columns),
        (encoder.channels + 1, rows, columns),
        (encoder.channels, rows // 2, columns),
        (1, encoder.channels, rows, columns),
    ):
        try:
            encoder.decode(np.zeros(wrong, np.float32), subject.grid)
        except (ValueError, UserError):
            continue
        raise Failed(f"maps of shape {wrong} were read")
    if subject.spec.max_contacts == 1:
        with must_refuse("a frame with two contacts"):
            encoder.encode(Contacts.truth([[-4, 0], [4, 0]], [2, 2]), subject.grid)


def another_grid(subject: EncoderSubject) -> None:
    """Rows, columns, origin and pitch of the maps are those of any grid that is asked for."""
    grid, encoder = Grid((40, 70), (-10.0, -3.0), 0.3), subject.encoder
    truth = Contacts.truth([[2.34, 5.43]], [4.0])
    maps = encoder.encode(truth, grid)
    require(maps.shape[1:] == grid.shape, f"maps of shape {maps.shape} for {grid.shape} cells")
    worst = max(_read_back(encoder, truth, grid))
    require(worst <= encoder.tolerance, f"{_label(truth)} came back off by {worst:.3g} mm")


def _random_contact(rng: np.random.Generator, shallowest: float = SHALLOW) -> Contacts:
    """Return one contact, anywhere in the range of places and depths."""
    xy = rng.uniform(-HALF_WIDTH, HALF_WIDTH, (1, 2))
    return Contacts.truth(xy, rng.uniform(shallowest, DEEP, 1))


def _random_pair(rng: np.random.Generator, distance: float, depth: object) -> Contacts:
    turn = rng.uniform(0, 2 * np.pi)
    half = 0.5 * distance * np.array([np.cos(turn), np.sin(turn)])
    centre = rng.uniform(-3, 3, 2)
    return Contacts.truth(np.array([centre - half, centre + half]), np.asarray(depth, np.float64))


def _read_back(encoder: Encoder, truth: Contacts, grid: Grid) -> tuple[float, float]:
    """Return the largest errors of position and depth after encoding and decoding, mm.

    Raises:
        Failed: The number of contacts changed, or two contacts were read as one.
    """
    decoded = encoder.decode(encoder.encode(truth, grid), grid)
    require(len(decoded) == len(truth), f"{_label(truth)} was read as {len(decoded)} contacts")
    return _largest_errors(decoded, truth)


def _largest_errors(found: Contacts, truth: Contacts) -> tuple[float, float]:
    """Return the largest errors of position and depth of the predictions nearest to the truth, mm.

    Raises:
        Failed: There is no prediction, or two true contacts have the same nearest prediction.
    """
    require(len(found), "no contact was read")
    nearest = np.linalg.norm(found.xy[:, None] - truth.xy[None], axis=-1).argmin(axis=0)
    require(len(set(nearest.tolist())) == len(truth), "two contacts were read as one")
    depth = np.abs(found.depth[nearest] - truth.depth).max()
    return float(np.abs(found.xy[nearest] - truth.xy).max()), float(depth)


def _label(contacts: Contacts) -> str:
    """Return a text such as "x -6.40 y 3.00 depth 0.50 mm" with all contacts."""
    rows = zip(contacts.xy.tolist(), contacts.depth.tolist(), strict=True)
    return " and ".join(f"x {x:.2f} y {y:.2f} depth {d:.2f} mm" for (x, y), d in rows)
