"""Errors of positions, depths and plate poses.

Of single presses the top-scored prediction is compared with the one true contact, axis by axis and
without a gate, which would hide the outliers that make RMSE differ from MAE. Frames without any
prediction have no error; they are left out of these metrics (n is smaller) and counted by `missed`.
Of other presses the contacts that are matched count: in the plane, along z, and between the tips.

Errors of plate poses are means over answered frames; coverage is the share of these frames.
Published predictions of the same frames are compared frame by frame. There is one row for every
published table that has some of these frames, named after the table.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from tactibench.contacts import Contacts
from tactibench.errors import UserError
from tactibench.metrics.spec import (
    MetricSpec,
    Rows,
    Sample,
    mean_metric,
    members,
    plate_rows,
)
from tactibench.metrics.trials import PlateTrials, Trials, runs
from tactibench.stats import (
    Estimate,
    FloatArray,
    IntArray,
    Labels,
    bca_interval,
    cluster_codes,
    cluster_sums,
    mean_interval,
    positive_mean_interval,
    r_squared,
    ratio_interval,
    rms_interval,
    root,
    share_interval,
)

AXES = ("x", "y", "z")
FORCE = "force_mae_n"
"""Metric that is computed wherever truth and answers know forces."""


def top_answers(trials: Trials) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the top answers to single presses.

    Returns:
        (n, 3) true and (n, 3) predicted x, y and depth of the answered frames, mm, and (n,) their
        trials.

    Raises:
        UserError: A trial of the group "all" has another number of true contacts than one.
    """
    for index in np.flatnonzero(members(trials, "all") & (trials.true_counts != 1)):
        raise UserError(
            f"the metrics of single presses (mae_mm, rmse_mm, r2 ...) need one true contact a "
            f"trial, but trial {index} has {trials.true_counts[index]}: ask for "
            f"position_mean_mm and depth_mae_mm in the protocol instead."
        )
    answered = np.flatnonzero(members(trials, "all") & (trials.predicted_counts > 0))
    true = [_first(trials.truth[i]) for i in answered]
    predicted = [_first(trials.predictions[i]) for i in answered]
    return np.array(true).reshape(-1, 3), np.array(predicted).reshape(-1, 3), answered


def _first(contacts: Contacts) -> tuple[float, float, float]:
    x, y = contacts.xy[0]
    return float(x), float(y), float(contacts.depth[0])


def mae(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the MAE of each axis and their mean; an axis that is not known has no value."""
    true, predicted, trial = top_answers(trials)
    error, press = np.abs(predicted - true), trials.press[trial]
    known = _known(error)
    for column, axis in enumerate(AXES):
        values = error[:, column][np.repeat(known[column], len(error))]
        yield axis, positive_mean_interval(values, press[: len(values)], level=trials.level)
    yield "mean", positive_mean_interval(_mean(error), press, level=trials.level)


def rmse(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield the RMSE of each axis and their mean.

    The interval of the mean follows by linearising the roots.
    """
    true, predicted, trial = top_answers(trials)
    squares = (predicted - true) ** 2
    press = trials.press[trial]
    known = _known(squares)
    for column, axis in enumerate(AXES):
        values = squares[:, column][np.repeat(known[column], len(squares))]
        yield axis, rms_interval(values, press[: len(values)], level=trials.level)
    yield "mean", _mean_of_roots(squares[:, known], press, trials.level)


def _mean_of_roots(squares: FloatArray, press: Labels, level: float) -> Estimate:
    if not len(squares):
        return Estimate.nothing()
    roots = np.sqrt(squares.mean(axis=0))
    value = float(roots.mean())
    # d sqrt(m) = d m / (2 sqrt(m)); an axis without any error contributes none
    slope = np.divide(0.5, roots, out=np.zeros_like(roots), where=roots > 0) / len(roots)
    linear = positive_mean_interval(value + (squares - roots**2) @ slope, press, level=level)
    return Estimate(value, linear.low, linear.high, linear.n, linear.clusters)


def r2(trials: Trials, rng: np.random.Generator) -> Rows:
    """Yield R^2 of each axis and their mean, with BCa intervals over presses.

    There is no value for a constant target, or one that is not known.
    """
    true, predicted, trial = top_answers(trials)
    codes, clusters = cluster_codes(trials.press[trial], len(trial))
    known = np.flatnonzero(_known(predicted - true)).tolist()
    columns = [(axis, [i] if i in known else []) for i, axis in enumerate(AXES)] + [("mean", known)]
    for axis, use in columns:
        if not len(trial) or not use or (np.ptp(true[:, use], axis=0) == 0).any():
            yield axis, Estimate(None, None, None, len(trial), clusters)
            continue
        statistic = r_squared(true[:, use], predicted[:, use], codes, clusters)
        value = float(statistic(np.ones((1, clusters)))[0])
        limits = bca_interval(statistic, clusters, rng=rng, level=trials.level)
        low, high = limits or (None, None)
        yield axis, Estimate(value, low, high, len(trial), clusters)


def rmse_over_bound(trials: Trials, _rng: np.random.Generator) -> Rows:
    """Yield sqrt(sum e^2 / sum b^2) of each axis, b the Cramer-Rao standard deviation.

    The limit is 1. For single presses e is the error of the top-scored prediction, without a gate.
    For presses with several contacts the sums are over all contacts that are matched inside the
    gate, so a model that misses contacts looks better than it is. Contacts without a bound (b is
    infinite, the contact is not in the frame) are left out of both sums: one of them would hide all
    others.
    """
    single = (trials.true_counts[members(trials, "all")] == 1).all()
    if trials.bound is None:
        yield from ((axis, Estimate.nothing()) for axis in AXES)
        return
    if single:
        true, predicted, trial = top_answers(trials)
        error, bound = predicted - true, np.array([trials.bound[i][0] for i in trial])
        bound = bound.reshape(-1, 3)
    else:
        error, bound, trial = _matched_errors(trials, trials.bound)
    for column, axis in enumerate(AXES):
        has = np.isfinite(bound[:, column])
        squares = error[has, column] ** 2
        press = trials.press[trial[has]]
        ratio = ratio_interval(
            squares, bound[has, column] ** 2, press, level=trials.level, floor=0.0
        )
        yield axis, root(ratio)


def _matched_errors(
    trials: Trials, bounds: Sequence[FloatArray]
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the (n, 3) errors and bounds of x, y, depth of pairs inside the gate, and (n,) trials.

    Args:
        trials: Test frames.
        bounds: (K, 3) Cramer-Rao standard deviations of x, y and depth of every trial, mm.
    """
    pairs = trials.matched
    places = zip(pairs.trial, pairs.truth, strict=True)
    bound = np.array([bounds[i][k] for i, k in places]).reshape(-1, 3)
    inside = members(trials, "all")[pairs.trial]
    return pairs.error[inside], bound[inside], pairs.trial[inside]


def _known(errors: FloatArray) -> npt.NDArray[np.bool_]:
    """Return (3,) whether truth and answers know an axis; x and y are always known."""
    return np.asarray(~np.isnan(errors).any(axis=0))


def _mean(errors: FloatArray) -> FloatArray:
    """Return the mean (n,) of errors (n, 3) over the axes that are known."""
    return np.asarray(errors[:, _known(errors)].mean(axis=1), dtype=np.float64)


def axis_mean_errors(trials: Trials) -> Sample:
    """Return the absolute error averaged over known axes, mm, one value per answered frame."""
    true, predicted, trial = top_answers(trials)
    return Sample(_mean(np.abs(predicted - true)), trial)


def axis_mean_squares(trials: Trials) -> Sample:
    """Return the squared error averaged over known axes, mm^2, one value per answered frame."""
    true, predicted, trial = top_answers(trials)
    return Sample(_mean((predicted - true) ** 2), trial)


def gated_distances(trials: Trials) -> Sample:
    """Return the distance of every pair inside the gate, mm."""
    return Sample(trials.matched.distance, trials.matched.trial)


def ungated_distances(trials: Trials) -> Sample:
    """Return the distance of every pair of the assignment without a gate, mm."""
    return Sample(trials.ungated.distance, trials.ungated.trial)


def depth_errors(trials: Trials) -> Sample:
    """Return |p - t| of the depth of every pair inside the gate, mm."""
    pairs = trials.matched
    return Sample(np.abs(pairs.predicted_depth - pairs.true_depth), pairs.trial)


def force_errors(trials: Trials) -> Sample:
    """Return | |p| - |t| | of the force of every pair of the assignment without a gate, N."""
    pairs = trials.ungated
    errors = [
        np.nan
        if (true := trials.truth[i].force) is None
        or (predicted := trials.predictions[i].force) is None
        else abs(float(np.linalg.norm(predicted[j]) - np.linalg.norm(true[k])))
        for i, k, j in zip(pairs.trial, pairs.truth, pairs.prediction, strict=True)
    ]
    return Sample(np.array(errors, dtype=np.float64), pairs.trial)


def plate_errors(trials: PlateTrials, field: str) -> Sample:
    """Return |p - t| of a field of the pose, such as "tilt", of every answered frame."""
    trial = np.flatnonzero([pose is not None for pose in trials.predictions])
    true = np.array([getattr(trials.truth[i], field) for i in trial], dtype=np.float64)
    predicted = np.array([getattr(trials.predictions[i], field) for i in trial], dtype=np.float64)
    return Sample(np.abs(predicted - true), trial)


def relative_depth_errors(trials: Trials) -> Sample:
    """Return |(p_i - p_j) - (t_i - t_j)| of depth of every two matched contacts of a frame, mm."""
    pairs = trials.matched
    error = pairs.predicted_depth - pairs.true_depth
    values, trial = [np.empty(0)], [np.empty(0, dtype=np.intp)]
    for number, rows in runs(pairs.trial):
        i, j = np.triu_indices(rows.stop - rows.start, k=1)
        values.append(np.abs(error[rows][i] - error[rows][j]))
        trial.append(np.full(len(i), number, dtype=np.intp))
    return Sample(np.concatenate(values), np.concatenate(trial))


plate_depth_errors = partial(plate_errors, field="depth")
tilt_errors = partial(plate_errors, field="tilt")


def answered(trials: PlateTrials) -> Sample:
    """Return 1 for every answered frame, 0 for the others."""
    values = np.array([p is not None for p in trials.predictions], dtype=np.float64)
    return Sample(values, np.arange(len(values)))


Errors = Callable[[PlateTrials], Sample]


def differences(trials: PlateTrials, table: str, errors: Errors) -> Sample:
    """Return |p - t| - |q - t| of every frame with both answers, q the published prediction.

    Args:
        trials: Test frames.
        table: Name of the published table.
        errors: Function that returns |p - t| of every answered frame.
    """
    ours = errors(trials)
    theirs = errors(replace(trials, predictions=trials.published[table]))
    _, i, j = np.intersect1d(ours.trial, theirs.trial, return_indices=True)
    return Sample(ours.values[i] - theirs.values[j], ours.trial[i])


def _difference(errors: Errors) -> Callable[[PlateTrials, np.random.Generator], Rows]:
    def rows(trials: PlateTrials, _rng: np.random.Generator) -> Rows:
        for table in trials.published:
            sample = differences(trials, table, errors)
            press = trials.press[sample.trial]
            yield table, mean_interval(sample.values, press, level=trials.level)

    return rows


def _p(errors: Errors) -> Callable[[PlateTrials, np.random.Generator], Rows]:
    def rows(trials: PlateTrials, rng: np.random.Generator) -> Rows:
        for table in trials.published:
            sample = differences(trials, table, errors)
            # The signs of a press's frames flip together.
            codes, presses = cluster_codes(trials.press[sample.trial], len(sample.trial))
            if presses > 1:
                from tactibench.stats import sign_flip_ps

                (p,) = sign_flip_ps(cluster_sums(sample.values[:, None], codes, presses), rng=rng)
                yield table, Estimate(p, None, None, len(sample.values), presses)

    return rows


_FORMULA = "mean of |p - t| - |q - t| over frames that both answered, q the released answer"


def _against_published(quantity: str, unit: str, errors: Errors) -> tuple[MetricSpec, MetricSpec]:
    """Return the metrics of the difference in a quantity, and of its p."""
    name = f"{quantity}_mae_minus_published"
    return (
        MetricSpec(
            f"{name}_{unit}",
            unit,
            "lower",
            f"{_FORMULA}; of {quantity}",
            plates=_difference(errors),
        ),
        MetricSpec(
            f"{name}_p",
            "p",
            "none",
            f"two-sided sign-flip permutation p of the difference in {quantity}, whole presses",
            plates=_p(errors),
        ),
    )


PUBLISHED_SPECS = (
    *_against_published("depth", "mm", plate_depth_errors),
    *_against_published("tilt", "deg", tilt_errors),
)
PUBLISHED_NAMES = tuple(spec.name for spec in PUBLISHED_SPECS)
"""Metrics that are computed wherever there are published predictions."""

SPECS = (
    MetricSpec(
        "r2",
        "",
        "higher",
        "1 - sum (p - t)^2 / sum (t - mean t)^2 per axis; mean: of the "
        "known ones; top-scored prediction, ungated",
        r2,
    ),
    MetricSpec(
        "mae_mm",
        "mm",
        "lower",
        "mean |p - t| per axis; mean: of the known ones; top-scored prediction, ungated",
        mae,
        sample=axis_mean_errors,
    ),
    MetricSpec(
        "rmse_mm",
        "mm",
        "lower",
        "sqrt(mean (p - t)^2) per axis; mean: of the known ones; top-scored prediction, ungated",
        rmse,
    ),
    mean_metric(
        "rmse_pooled_mm",
        "mm",
        "lower",
        "sqrt(mean of (p - t)^2 over frames and axes)",
        axis_mean_squares,
        rms_interval,
        lambda t: {"all": members(t, "all")},
        root=True,
    ),
    MetricSpec(
        "rmse_over_bound",
        "",
        "lower",
        "sqrt(sum (p - t)^2 / sum b^2) per axis, b the "
        "Cramer-Rao standard deviation of each frame that has one; of presses with several "
        "contacts over pairs inside the gate",
        rmse_over_bound,
    ),
    mean_metric(
        "position_mean_mm",
        "mm",
        "lower",
        "mean |p_xy - t_xy| over pairs inside the gate",
        gated_distances,
    ),
    mean_metric(
        "position_ungated_mm",
        "mm",
        "lower",
        "mean |p_xy - t_xy| over the pairs of the minimum-cost assignment without a gate",
        ungated_distances,
    ),
    mean_metric(
        "depth_mae_mm",
        "mm",
        "lower",
        "mean |p_depth - t_depth| over pairs inside the gate; for plates over answered frames",
        depth_errors,
        plates=plate_rows(plate_depth_errors, positive_mean_interval),
        plate_sample=plate_depth_errors,
        needs_depth=True,
    ),
    mean_metric(
        FORCE,
        "N",
        "lower",
        "mean | |p_force| - |t_force| | over the pairs of the minimum-cost assignment without a "
        "gate, where truth and answer know the force",
        force_errors,
    ),
    mean_metric(
        "relative_depth_mae_mm",
        "mm",
        "lower",
        "mean |(p_i - p_j) - (t_i - t_j)| of depth "
        "over every two contacts of a frame that are both matched",
        relative_depth_errors,
        needs_depth=True,
    ),
    MetricSpec(
        "tilt_mae_deg",
        "deg",
        "lower",
        "mean |p_tilt - t_tilt| over answered frames",
        plates=plate_rows(tilt_errors, positive_mean_interval),
        plate_sample=tilt_errors,
    ),
    MetricSpec(
        "coverage",
        "share",
        "higher",
        "answered frames / frames",
        plates=plate_rows(answered, share_interval),
        plate_sample=answered,
    ),
    *PUBLISHED_SPECS,
)
