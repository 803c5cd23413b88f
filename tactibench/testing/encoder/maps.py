"""Maps as networks draw them, and maps that cannot be read."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from tactibench.contacts import Contacts
from tactibench.errors import UserError, describe_exception
from tactibench.plugins.base import Encoder
from tactibench.testing.encoder.subject import DEEP, EncoderSubject, errors, single, words
from tactibench.testing.parameters import check_parameters
from tactibench.testing.property import Failed, NotApplicable, guarded, refused, require

METHODS = ("encode", "decode", "decode_batch")
NUMBERS = ("channels", "separation", "tolerance")
NOISE = 0.02


def target(subject: EncoderSubject) -> None:
    """The class behind the spec loads, builds, and has encode, decode, decode_batch and limits."""
    with guarded(f"building {subject.spec.target}"):
        encoder: Encoder = subject.encoder
    lacking = [name for name in METHODS if not callable(getattr(encoder, name, None))]
    lacking += [
        name for name in NUMBERS if not isinstance(getattr(encoder, name, None), int | float)
    ]
    require(not lacking, f"it has no {', '.join(lacking)}")
    require(encoder.channels >= 1, f"channels is {encoder.channels}")
    require(encoder.tolerance > 0, f"tolerance is {encoder.tolerance} mm; it must be positive")
    require(encoder.separation > 0, f"separation is {encoder.separation} mm; it must be positive")


def parameters(subject: EncoderSubject) -> None:
    """Every allowed value of a parameter builds or is refused in words; any other is refused."""
    check_parameters(subject.spec, subject.values, subject.build)


def noise(subject: EncoderSubject) -> None:
    """White noise of 0.02 moves the best contact little, and its depth by no more than 0.36 mm."""
    subject.must_be_heat()
    rng = np.random.default_rng(4)
    lists = [single(rng, shallowest=2.0) for _ in range(200)]
    maps = subject.encoded(lists)
    maps = maps + NOISE * rng.standard_normal(maps.shape, dtype=np.float32)
    found = [one.top(1) for one in subject.decoded(maps)]
    depth = [errors(f, t)[1] for f, t in zip(found, lists, strict=True)]
    away = np.array([f.xy[0] - t.xy[0] for f, t in zip(found, lists, strict=True)])
    rms = float(np.sqrt(np.mean(np.square(away)))) / subject.grid.pitch
    require(rms < subject.noise_cells, f"rms {rms:.3g} cells, at most {subject.noise_cells:g}")
    off, most = float(np.sqrt(np.mean(np.square(depth)))), 3 * NOISE * DEEP
    require(off < most, f"the depth is off by {off:.3g} mm rms, at most {most:.2g} mm")


def pure(subject: EncoderSubject) -> None:
    """Maps are left as they are, may be read-only, and are read alike in a batch and alone."""
    rng = np.random.default_rng(7)
    lists = [single(rng) for _ in range(70)]
    maps = subject.encoded(lists)
    _same_batch(subject, lists, maps)
    maps = maps + 0.01 * rng.random(maps.shape, dtype=np.float32)
    before = maps.copy()
    together = subject.decoded(maps)
    require(np.array_equal(maps, before), "decode_batch changed the maps")
    alone = maps.copy()
    for one in alone:
        subject.encoder.decode(one, subject.grid)
    require(np.array_equal(alone, before), "decode changed the maps")
    maps.setflags(write=False)
    with guarded("reading maps that may not be written to"):
        found = [subject.encoder.decode(one, subject.grid) for one in maps]
        subject.decoded(maps)
    for one, other in zip(found, together, strict=True):
        _alike(one, other, 1e-9, "alone and in a batch")


def _same_batch(subject: EncoderSubject, lists: list[Contacts], maps: np.ndarray) -> None:
    """Training encodes in batches."""
    batch = subject.encoder.encode_batch
    require(np.array_equal(batch(lists, subject.grid), maps), "encode_batch differs from encode")
    none = np.asarray(batch([], subject.grid)).shape
    wanted = (0, subject.encoder.channels, *subject.grid.shape)
    require(none == wanted, f"encode_batch of no contacts has shape {none}, expected {wanted}")


def dtype(subject: EncoderSubject) -> None:
    """Maps of float16 and float64, strided or in Fortran order, are read as those of float32."""
    encoder, grid = subject.encoder, subject.grid
    maps = encoder.encode(Contacts.truth([[1.11, -2.22]], [4.0]), grid)
    expected = encoder.decode(maps, grid)
    for kind, slack in ((np.float64, 1e-6), (np.float16, 0.02)):
        wide = np.empty((*maps.shape[:2], 2 * maps.shape[2]), kind)
        wide[:, :, ::2] = maps
        for given in (maps.astype(kind), wide[:, :, ::2], np.asfortranarray(maps.astype(kind))):
            with guarded(f"reading {np.dtype(kind)} maps"):
                found = encoder.decode(np.asanyarray(given), grid)
            _alike(found, expected, slack, f"as {np.dtype(kind)}")


def scores(subject: EncoderSubject) -> None:
    """Scores lie in 0..1 and fall with the heat; noise is read as a bounded number of contacts."""
    encoder, grid = subject.encoder, subject.grid
    maps = encoder.encode(Contacts.truth([[1.2, -2.1]], [DEEP]), grid)
    with guarded("a map 5 % above 1"):
        full = encoder.decode(1.05 * maps, grid)
    require(len(full) and full.score[0] == 1.0, f"maps 5 % above 1 have the scores {full.score}")
    faint = [encoder.decode(np.float32(share) * maps, grid).score for share in (1.0, 0.8, 0.5)]
    require(all(map(len, faint)), "at half its heat, a contact of 6 mm was not read")
    best = [float(score[0]) for score in faint]
    require(all(a > b for a, b in pairwise(best)), f"of heat 1, 0.8 and 0.5 scores are {best}")
    noisy = np.random.default_rng(8).random((20, *maps.shape))
    low, high = grid.xy(0, 0) - 2.5, grid.xy(grid.shape[0] - 1, grid.shape[1] - 1) + 2.5
    for found in subject.decoded(noisy):
        require(len(found) <= subject.most, f"{len(found)} contacts were read from noise")
        inside = ((found.xy >= low) & (found.xy <= high)).all()
        require(inside, "a contact was read more than 2.5 mm outside the grid")


def finite(subject: EncoderSubject) -> None:
    """Maps that hold NaN or infinity are refused, alone and in a batch."""
    for bad in (np.nan, np.inf, -np.inf):
        maps = np.zeros((subject.encoder.channels, *subject.grid.shape), np.float32)
        maps[-1, 5, 6] = bad
        with refused(f"a map that holds {bad}"):
            subject.encoder.decode(maps, subject.grid)
        with refused(f"a batch that holds {bad}"):
            subject.decoded(maps[None])


def shape(subject: EncoderSubject) -> None:
    """Maps of another shape than the grid's are refused."""
    channels, (rows, columns) = subject.encoder.channels, subject.grid.shape
    for wrong in (
        (rows, columns),
        (channels + 1, rows, columns),
        (channels, rows // 2, columns),
        (1, channels, rows, columns),
    ):
        try:
            found = subject.encoder.decode(np.zeros(wrong, np.float32), subject.grid)
        except (ValueError, UserError):
            continue
        except Exception as error:
            raise Failed(f"maps of shape {wrong} raised {describe_exception(error)}") from error
        raise Failed(f"maps of shape {wrong} were read as {len(found)} contacts")


def depth_range(subject: EncoderSubject) -> None:
    """A contact deeper than can be shown, or above the skin, is refused or comes back as it is."""
    encoder, grid = subject.encoder, subject.grid
    deepest = float(subject.values.get("max_depth", DEEP))
    for depth in (1.05 * deepest, -0.1):
        truth = Contacts.truth([[0.0, 0.0]], [depth])
        try:
            found = encoder.decode(encoder.encode(truth, grid), grid)
        except UserError:
            continue
        require(len(found) == 1, f"{words(truth)} was taken, and read as {len(found)} contacts")
        worst = max(errors(found, truth))
        require(
            worst <= encoder.tolerance,
            f"{words(truth)} was taken, and came back off by {worst:.3g} mm",
        )


def too_many(subject: EncoderSubject) -> None:
    """An encoder of one contact refuses two in a frame."""
    if subject.spec.max_contacts != 1:
        raise NotApplicable("it shows several contacts")
    with refused("a frame with two contacts"):
        subject.encoder.encode(Contacts.truth([[-4, 0], [4, 0]], [2, 2]), subject.grid)


def _alike(found: Contacts, expected: Contacts, slack: float, how: str) -> None:
    require(len(found) == len(expected), f"{how}: {len(found)} contacts, not {len(expected)}")
    if len(found):
        away = max(np.abs(found.xy - expected.xy).max(), np.abs(found.depth - expected.depth).max())
        require(away <= slack, f"{how}: read {away:.3g} mm apart")
