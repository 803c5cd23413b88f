"""The table of metrics as a whole."""

import numpy as np
import pytest

from tactibench import UserError
from tactibench.contacts import Contacts, PlatePose
from tactibench.metrics import PlateTrials, Trials
from tactibench.metrics.registry import score

AXES = ["x", "y", "z", "mean"]
EXP1 = {
    "r2": AXES,
    "mae_mm": AXES,
    "rmse_mm": AXES,
    "rmse_pooled_mm": ["all"],
    "surface_rmse_mm": ["all"],
    "rmse_over_bound": AXES[:3],
    "missed": ["all"],
    "spurious": ["all"],
}
CONTACTS = [
    "position_mean_mm",
    "position_ungated_mm",
    "depth_mae_mm",
    "gospa1_mm",
    "gospa2_mm",
    "missed",
    "spurious",
    "surface_rmse_mm",
]
DISTANCE = ["distance_mae_mm", "distance_penalised_mm", "resolved", "orientation_mae_deg"]
EXP2 = {name: ["6.5", "8.0", "12.0", "all"] for name in DISTANCE} | {
    name: ["all"] for name in ["threshold_mm", "catch_resolved", "d_prime", *CONTACTS]
}
EXP3 = {name: ["dual", "triple", "all"] for name in [*CONTACTS, "relative_depth_mae_mm"]}
TABLES = [("singles", EXP1), ("two_point", EXP2), ("kinds", EXP3)]
SHARES = {"resolved", "missed", "catch_resolved"}


def rng():
    return np.random.default_rng(7)


def rebuilt(trials, predictions=None, order=None):
    order = range(len(trials)) if order is None else order
    predictions = trials.predictions if predictions is None else predictions
    pick = lambda column: tuple(column[i] for i in order)  # noqa: E731
    return Trials(
        pick(trials.truth), pick(predictions), trials.press[list(order)], pick(trials.group)
    )


@pytest.mark.parametrize(("source", "table"), TABLES)
def test_names_and_groups_are_those_of_the_protocol(source, table, request):
    rows = score(list(table), request.getfixturevalue(source), rng=rng())
    assert [(r.metric, r.group) for r in rows] == [(m, g) for m, gs in table.items() for g in gs]


@pytest.mark.parametrize(("source", "table"), TABLES)
def test_the_order_of_trials_and_contacts_does_not_matter(source, table, request):
    trials = request.getfixturevalue(source)
    mixed = np.random.default_rng(1)
    turned = []
    for p in trials.predictions:
        order = mixed.permutation(len(p))
        turned.append(Contacts(p.xy[order], p.depth[order], p.score[order]))
    other = rebuilt(trials, turned, mixed.permutation(len(trials)))
    # The bootstrap of r2 depends on the order; a threshold is fitted to the shares of `resolved`.
    names = [n for n in table if n not in ("r2", "threshold_mm")]
    for a, b in zip(score(names, trials, rng=rng()), score(names, other, rng=rng()), strict=True):
        assert (a.metric, a.group, a.n, a.clusters) == (b.metric, b.group, b.n, b.clusters)
        for x, y in ((a.value, b.value), (a.low, b.low), (a.high, b.high)):
            assert x == pytest.approx(y, abs=1e-6) if x is not None else y is None


@pytest.mark.parametrize(("source", "table"), TABLES)
def test_a_perfect_prediction(source, table, request):
    trials = request.getfixturevalue(source)
    for row in score(list(table), rebuilt(trials, trials.truth), rng=rng()):
        if row.metric in {"resolved", "r2"}:
            assert row.value == 1
        elif row.metric == "threshold_mm":
            assert (row.value, row.censored) == (6.5, "<")
        elif row.metric == "d_prime":
            assert row.value > 4
        elif row.metric in {"surface_rmse_mm", "rmse_over_bound"}:
            assert row.value is None  # no maps and no bound were handed in
        else:
            assert row.value == 0, row


@pytest.mark.parametrize(("source", "table"), TABLES)
def test_no_predictions_at_all(source, table, request):
    trials = request.getfixturevalue(source)
    empty = rebuilt(trials, [Contacts.none()] * len(trials))
    for row in score(list(table), empty, rng=rng()):
        if row.metric in {"missed"}:
            assert row.value == 1
        elif row.metric in {"resolved", "spurious", "catch_resolved"}:
            assert row.value == 0
        elif row.metric == "gospa1_mm":
            contacts = [
                len(t)
                for t, g in zip(trials.truth, trials.group, strict=True)
                if g != "catch" and row.group in ("all", g)
            ]
            assert row.value == pytest.approx(1.5 * np.mean(contacts))
        elif row.metric == "threshold_mm":
            assert (row.value, row.censored) == (12.0, ">")
        elif row.metric in {"distance_penalised_mm", "gospa2_mm"}:
            assert row.value > 0
        elif row.metric == "d_prime":
            # the rates differ by the correction alone
            n, m = 180, 60
            from statistics import NormalDist

            z = NormalDist().inv_cdf
            assert row.value == pytest.approx(z(0.5 / (n + 1)) - z(0.5 / (m + 1)))
        else:
            assert row.value is None, row
            assert row.n == 0


def test_no_trials_at_all_give_rows_without_values():
    rows = score(list(EXP1) + list(EXP3), Trials((), (), [], ()), rng=rng())
    assert {(r.value, r.n, r.clusters) for r in rows} == {(None, 0, 0)}


def test_catch_trials_change_nothing_but_their_own_metrics(two_point):
    index = [i for i, g in enumerate(two_point.group) if g != "catch"]
    names = [n for n in EXP2 if n not in {"catch_resolved", "d_prime"}]
    assert score(names, two_point, rng=rng()) == score(
        names, rebuilt(two_point, order=index), rng=rng()
    )


@pytest.mark.parametrize(("source", "table"), TABLES)
def test_values_lie_inside_their_intervals_and_ranges(source, table, request):
    names = [n for n in table if n != "threshold_mm"]
    for row in score(names, request.getfixturevalue(source), rng=rng()):
        if row.low is not None and row.high is not None:
            assert row.low <= row.value <= row.high
        if row.metric in SHARES:
            assert 0 <= row.low <= row.high <= 1
        if row.metric not in {"r2", "d_prime"} and row.low is not None:
            assert row.low >= 0


def test_an_interval_does_not_depend_on_the_other_names(singles):
    alone = score(["r2"], singles, rng=rng())
    assert score(["mae_mm", "r2", "missed"], singles, rng=rng())[4:8] == alone
    assert alone[0].low < alone[0].value < alone[0].high


def test_an_unknown_metric_is_named_with_its_neighbour(singles):
    with pytest.raises(UserError, match=r"no metric 'rsme_mm'; did you mean 'rmse_mm'"):
        score(["rsme_mm"], singles, rng=rng())


def test_a_metric_of_the_other_kind_is_refused(singles):
    plates = PlateTrials((PlatePose(1, 2),), (None,), [0])
    with pytest.raises(UserError, match="plate poses"):
        score(["gospa1_mm"], plates, rng=rng())
    with pytest.raises(UserError, match="contacts"):
        score(["tilt_mae_deg"], singles, rng=rng())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"group": ("all",)}, "group has 1"),
        ({"maps": np.ones((3, 4, 4))}, "maps has 3"),
        ({"bound": (np.ones((1, 3)),)}, "bound has 1"),
    ],
)
def test_trials_that_do_not_fit_are_refused(change, message):
    one = (Contacts.truth([[0, 0]], [1]),) * 2
    fields = {"truth": one, "predictions": one, "press": [0, 1], "group": ("all",) * 2}
    with pytest.raises(ValueError, match=message):
        Trials(**(fields | change))
