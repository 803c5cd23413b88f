"""Estimate the errors of the labels of plate presses: mean absolute errors, mm and deg.

    python -P benchmarks/label_scatter.py path/to/331/model_surface2d path/to/127/model_surface2d

Test presses of ``surface`` are left out, and in every folder those of the published list. Labels
are compared with the pins by a kernel regression in which no press takes part in its own
prediction.

* move: the table says how the plate moved on the way in, sideways (move_1) and turning (move_6).
  Some frames do not show this move: their pins stand as for the label less the turn. ``share`` is
  the share of such frames among those with a clear turn. ``move`` is the error that this causes in
  the labels of all presses: by the turn, and by a slope times move_1.
* For presses that show the move and for those that do not, correlations are printed: of the mean
  pin's shift with move_1; of the place about which the pins spread with the sine of the label, and
  with that of the label less the turn (no regression has a part in these); and of the turn with the
  turn that the pins show.
* rest: the other scatter of the labels. ``held out`` is the error of the prediction, which is too
  large by the error of the regression. ``equal frames`` extrapolates the differences between the
  residuals of two presses, of which neither helped to predict the other, to pins that moved alike.
  ``pins`` is the change of the predictions by noise of the pins, the most that this noise can add
  to ``equal frames``.
* labels: move and rest together, at least (all of ``pins`` subtracted from the rest) and at most.

Brackets: 95 % intervals from resampled presses; the regression is not fitted again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree
from scipy.special import erf

from tactibench.datasets import direction_of, middle_of_spread, open_recording
from tactibench.errors import UserError
from tactibench.frames import published_frames
from tactibench.markers import Tracker
from tactibench.protocols import load_protocol, split_recorded
from tactibench_pins import Components, Features, Setting, kernel

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.intp]

SETTING = Setting(components=40, whitening=0.25, length=1.0, ridge=3e-4)
COLUMNS = ("pose_2", "pose_6", "move_1", "move_6")
NEIGHBOURS, BINS, NEAR = 10, 6, 0.8
"""Nearest presses that are paired with each press, bins of their distances, share of the pairs that
is used."""
TURNED_DEG = 2.0
"""Turns from which a frame without its move can be recognised with certainty."""
GROSS = 12.0
"""A press whose residual is more than so many median residuals fits neither with its move nor
without it, and is left out."""
ROUNDS, RESAMPLES = 20, 400


def training_presses(folder: Path) -> tuple[Array, Array, Array]:
    """Return displacements (N, P, 2) px, pins at rest (P, 2) px, and labels (N, 4) of COLUMNS.

    Raises:
        UserError: The folder has no frame of the undeformed sensor.
    """
    recording, protocol = open_recording(folder), load_protocol("surface")
    rest, spec = recording.rest_image(), protocol.spec
    if rest is None or spec.recorded is None:
        raise UserError(f"{folder} has no frame of the undeformed sensor (init_0.png).")
    published = published_frames(protocol, recording.names, list(rest.shape))
    split = split_recorded(recording.names, spec.recorded, spec.data_seed, published)
    listed = set(protocol.test_frames)
    rows = [r for r in sorted(split.fit + split.validation) if recording.names[r] not in listed]
    tracker = Tracker(rest)
    xy = [tracker.track(recording.image(row)[np.newaxis]).xy for row in rows]
    moved = np.concatenate(xy) - tracker.rest
    labels = recording.complete_labels()
    return moved, tracker.rest, np.column_stack([labels[name][rows] for name in COLUMNS])


class HeldOut:
    """Kernel regression on displacements (N, 2 P) that predicts presses without themselves."""

    def __init__(self, moved: Array) -> None:
        self.features = Features(Components.fit(moved, SETTING.components), moved, moved[:, :0])
        self.places, self.length = self.features.places(SETTING)
        gram = kernel(self.places, self.places, self.length)
        self.inverse = np.linalg.inv(gram + SETTING.ridge * np.eye(len(gram)))

    def residuals(self, labels: Array, parts: Numbers | None = None) -> Array:
        """Return (N, T) labels less predictions without the press, or without its part.

        Rasmussen and Williams 2006, eq. 5.12, for the presses of a part at once.

        Args:
            labels: (N, T) labels.
            parts: (N,) number of the part of each press; None: each press is its own part.
        """
        weights = self.inverse @ (labels - labels.mean(axis=0))
        if parts is None:
            alone: Array = weights / np.diag(self.inverse)[:, None]
            return alone
        out: Array = np.empty_like(weights)
        for rows in (np.flatnonzero(parts == part) for part in np.unique(parts)):
            out[rows] = np.linalg.solve(self.inverse[np.ix_(rows, rows)], weights[rows])
        return out

    def pin_noise(self, labels: Array, rng: np.random.Generator) -> Array:
        """Return the (T,) mean absolute change of predictions by noise of the pins.

        Most of the many patterns of the pins hold noise alone, so that its variance is the median
        variance of the patterns.
        """
        moved = self.features.moved
        noise = np.sqrt(np.median(np.linalg.eigvalsh(np.cov(moved.T))))
        noisy, _ = self.features.places(SETTING, moved + rng.normal(0, noise, moved.shape))
        clean, changed = (kernel(p, self.places, self.length) for p in (self.places, noisy))
        change = (changed - clean) @ (self.inverse @ (labels - labels.mean(axis=0)))
        return np.asarray(np.abs(change).mean(axis=0))


@dataclass(frozen=True, eq=False)
class Scatter:
    """Errors of the labels (depth, mm, and tilt, deg); the head of this file explains the words.

    Attributes:
        unmade: (N,) whether a press does not show its move.
        turned: (N,) whether a press should turn by more than TURNED_DEG.
        off: (N, 2) errors of depth and tilt by a move that is not shown.
        gross: (N,) whether a press fits neither with its move nor without it; such presses are not
            counted.
        held_out: (N, 2) residuals of the labels less ``off``.
        pins: (2,) change of predictions by the noise of the pins.
        pairs: (M, 2) rows of presses that are near each other.
        apart: (M,) distance of each pair in the displacements.
        differences: (M, 2) differences between the residuals of each pair, neither of which helped
            to predict the other.
    """

    unmade: Flags
    turned: Flags
    off: Array
    gross: Flags
    held_out: Array
    pins: Array
    pairs: Numbers
    apart: Array
    differences: Array

    def equal_frames(self, weights: Array) -> Array:
        """Return the (2,) mean absolute scatter at equal displacements.

        It is the variogram of the residuals (Cressie 1993, 2.4) at distance 0, by absolute
        differences, which are robust against outliers: for normal scatter s,
        E|e_i - e_j| = sqrt(2) E|e|.

        Args:
            weights: (N,) weights of the presses.
        """
        edges = np.quantile(self.apart, np.linspace(0, NEAR, BINS + 1))
        bins = np.searchsorted(edges, self.apart, side="right") - 1
        use = bins < BINS
        w = weights[self.pairs].prod(axis=1) * use
        count = np.bincount(bins, w, BINS + 1)[:BINS]
        far = np.bincount(bins, w * self.apart**2, BINS + 1)[:BINS] / count
        means = (
            np.bincount(bins, w * np.abs(d) / np.sqrt(2), BINS + 1)[:BINS] / count
            for d in self.differences.T
        )
        nuggets = [np.polyfit(far, mean**2, 1)[1] for mean in means]
        return np.asarray(np.sqrt(np.maximum(nuggets, 0.0)))

    def figures(self, weights: Array) -> dict[str, Array]:
        """Return name -> (2,) figures of depth and tilt, with (N,) weights of the presses."""
        weights = weights * ~self.gross
        held_out = np.average(np.abs(self.held_out), axis=0, weights=weights)
        equal = self.equal_frames(weights)
        most = np.minimum(equal, held_out)
        least = np.sqrt(np.maximum(most**2 - self.pins**2, 1e-12))
        return {
            "share": np.full(2, np.average(self.unmade, weights=weights * self.turned)),
            "move": np.average(np.abs(self.off), axis=0, weights=weights),
            "held out": held_out,
            "equal frames": equal,
            "labels at least": np.average(folded_mean(self.off, least), axis=0, weights=weights),
            "at most": np.average(folded_mean(self.off, most), axis=0, weights=weights),
        }


def folded_mean(off: Array, rest: Array) -> Array:
    """Return E|off + e| of a normal e with E|e| = rest."""
    s = rest * np.sqrt(np.pi / 2)
    return np.asarray(rest * np.exp(-((off / s) ** 2) / 2) + off * erf(off / s / np.sqrt(2)))


def scatter(moved: Array, labels: Array, rng: np.random.Generator) -> Scatter:
    """Return the errors of labels (N, 4) of COLUMNS, judged by displacements (N, 2 P), px."""
    regression, turn, side = HeldOut(moved), labels[:, 3], labels[:, 2]
    off, unmade = np.zeros((len(labels), 2)), np.zeros(len(labels), dtype=bool)
    for _ in range(ROUNDS):
        residual = regression.residuals(labels[:, :2] - off) + off
        before, unmade = unmade, np.abs(residual[:, 1] - turn) < np.abs(residual[:, 1])
        slope = median_slope(side[unmade], residual[unmade, 0]) if unmade.any() else 0.0
        off = np.column_stack([slope * side, turn]) * unmade[:, None]
        if np.array_equal(before, unmade):
            break
    held_out = regression.residuals(labels[:, :2] - off)
    strange = np.abs(held_out) > GROSS * np.median(np.abs(held_out), axis=0)
    gross = np.asarray(strange.any(axis=1))
    halves = rng.permutation(len(labels)) % 2
    residual = regression.residuals(labels[:, :2] - off, halves)
    pairs, apart = near_pairs(regression.places, halves, np.flatnonzero(~gross))
    return Scatter(
        unmade,
        np.asarray(np.abs(turn) > TURNED_DEG),
        off,
        gross,
        held_out,
        regression.pin_noise(labels[:, :2] - off, rng),
        pairs,
        apart,
        residual[pairs[:, 0]] - residual[pairs[:, 1]],
    )


def median_slope(x: Array, y: Array) -> float:
    """Return the slope of y against x through 0 that has the least absolute residuals."""
    order = np.argsort(y / x)
    weight = np.cumsum(np.abs(x[order]))
    return float((y / x)[order][np.searchsorted(weight, weight[-1] / 2)])


def near_pairs(places: Array, halves: Numbers, rows: Numbers) -> tuple[Numbers, Array]:
    """Return the (M, 2) rows of presses of one half that are near each other, and their distances.

    Args:
        places: (N, D) places of the presses.
        halves: (N,) number of the half of each press, 0 or 1.
        rows: Rows of the presses that take part.
    """
    pairs, apart = [], []
    for half in (rows[halves[rows] == number] for number in (0, 1)):
        far, near = cKDTree(places[half]).query(places[half], k=NEIGHBOURS + 1)
        pairs.append(np.column_stack([np.repeat(half, NEIGHBOURS), half[near[:, 1:].ravel()]]))
        apart.append(far[:, 1:].ravel())
    return np.concatenate(pairs), np.concatenate(apart)


def intervals(
    of: Callable[[Array], dict[str, Array]], count: int, rng: np.random.Generator
) -> dict[str, Array]:
    """Return name -> (3, 2) figures with their lower and upper limits over resampled presses.

    Args:
        of: Function that returns the figures for (N,) weights of the presses.
        count: Number N of presses.
        rng: Source of the resamples.
    """
    drawn = [
        of(rng.multinomial(count, np.full(count, 1 / count)).astype(float))
        for _ in range(RESAMPLES)
    ]
    return {
        name: np.vstack(
            [value[None], np.quantile([d[name] for d in drawn], (0.025, 0.975), axis=0)]
        )
        for name, value in of(np.ones(count)).items()
    }


def show_moves(found: Scatter, moved: Array, rest: Array, labels: Array) -> None:
    middle, shift = middle_of_spread(moved, rest), moved.mean(axis=1)
    for name, group in (("shown", ~found.unmade), ("not shown", found.unmade)):
        rows = group & found.turned & ~found.gross
        _, tilt, side, turn = labels[rows].T
        follows = max(abs(np.corrcoef(axis, side)[0, 1]) for axis in shift[rows].T)
        plain, less = (direction_of(middle[rows], t)[1] for t in (tilt, tilt - turn))
        flat = np.concatenate([moved[rows, :, 0], moved[rows, :, 1]], axis=1)
        seen = turn - HeldOut(flat).residuals(turn[:, None])[:, 0]
        print(
            f"  move {name}: {rows.sum():,} presses; shift and move_1 {follows:.2f}; centre and "
            f"label {plain:.3f}, less the turn {less:.3f}; turn and what the pins tell of it "
            f"{np.corrcoef(seen, turn)[0, 1]:.2f}, off by {np.abs(seen - turn).mean():.2f} deg"
        )


@click.command(help=__doc__.splitlines()[0])
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--seed", default=0, help="of halves, noise and resamples")
def main(folders: tuple[Path, ...], seed: int) -> None:
    for folder in folders:
        rng = np.random.default_rng(seed)
        moved, rest, labels = training_presses(folder)
        errors = scatter(np.concatenate([moved[..., 0], moved[..., 1]], axis=1), labels, rng)
        figures = intervals(errors.figures, len(labels), rng)
        print(f"{folder}: {len(labels):,} presses, {errors.gross.sum()} that fit neither left out")
        show_moves(errors, moved, rest, labels)
        for number, (name, digits) in enumerate((("depth, mm", 4), ("tilt, deg", 3))):
            print(f"  {name}: pins {errors.pins[number]:.{digits}f}", end="")
            for figure, values in figures.items():
                value, low, high = values[:, number]
                print(
                    f"; {figure} {value:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]", end=""
                )
            print()


if __name__ == "__main__":
    main()
