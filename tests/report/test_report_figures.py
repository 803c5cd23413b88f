"""Figures: their numbers are the metrics' own, and Plotly knows every key that they use."""

from __future__ import annotations

import numpy as np
import pytest
from report_material import DISTANCES, contact_parts, exp2_metrics, pair_parts
from scipy.optimize import minimize

from tactibench.board.html.answers import answered, stored_contacts, unpacked_truth
from tactibench.board.html.distance import distance_panels, fitted
from tactibench.board.html.error_map import CELLS, error_maps, errors_of
from tactibench.board.html.figure import Looks, log_axis, rounded
from tactibench.board.html.frontier import frontier_panel
from tactibench.board.html.worst import frame_errors
from tactibench.board.ranking import RANKING
from tactibench.board.rows import rows_of
from tactibench.metrics.score import score
from tactibench.metrics.threshold import fit_threshold
from tactibench.protocols.loader import load_protocol
from tactibench.records.answers import unpack_contacts

KEYS = {name: load_protocol(name).keys for name in ("exp1", "exp2", "exp3")}


def of(protocol, parts):
    truth = unpacked_truth(KEYS[protocol], parts["truth"])
    return answered(KEYS[protocol], truth, parts["predictions"])


def figures(panel):
    return [figure for option in panel.options for figure in option.figures]


def valid(figure):
    """Raises ValueError for a key or value that Plotly does not know."""
    objects = pytest.importorskip("plotly.graph_objects", reason="needs tactibench[report]")
    objects.Figure(data=list(figure.data), layout=dict(figure.layout))


def pairs(fabricate, **more):
    metrics = exp2_metrics(more.pop("share", 0.2))
    return fabricate("exp2", error=2.0, metrics=metrics, **more)


def test_stored_contacts_are_those_that_were_packed():
    for parts in (contact_parts(), pair_parts()):
        for part in ("truth", "predictions"):
            slow, fast = unpack_contacts(parts[part]), stored_contacts(parts[part])
            assert len(slow) == len(fast)
            for a, b in zip(slow, fast, strict=True):
                assert len(a) == len(b)
                for name in ("xy", "depth", "score"):
                    np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@pytest.mark.parametrize(("name", "value"), [("count", [99]), ("depth", [np.nan]), ("xy", [1.0])])
def test_stored_contacts_that_do_not_fit_are_refused(name, value):
    arrays = dict(contact_parts(frames=1)["truth"])
    arrays[name] = np.array(value)
    with pytest.raises(ValueError, match=r"counted|finite"):
        stored_contacts(arrays)


def test_the_drawn_curve_is_the_most_likely_logistic_through_the_threshold():
    rng = np.random.default_rng(3)
    distance = np.repeat([float(d) for d in DISTANCES], 60)
    hits = (rng.random(len(distance)) < 1 / (1 + np.exp(-(1.4 * (distance - 8.2))))).astype(float)
    estimate = fit_threshold(distance, hits, np.arange(len(distance)))
    assert estimate.censored is None
    shares = {d: float(hits[distance == float(d)].mean()) for d in DISTANCES}
    rows = [{"metric": "resolved", "group": d, "n": 60, "value": v} for d, v in shares.items()]
    rows.append({"metric": "threshold_mm", "group": "all", "value": estimate.value})

    def negative(theta):  # intercept and slope, in no way the metric's parameters
        eta = theta[0] + theta[1] * (distance - 8)
        return float(np.logaddexp(0, -np.where(hits > 0, eta, -eta)).sum())

    best = minimize(negative, [0.0, 1.0], method="BFGS").x
    at = np.linspace(6.5, 12, 7)
    found = fitted({"metrics": rows}, at)
    np.testing.assert_allclose(found, 1 / (1 + np.exp(-(best[0] + best[1] * (at - 8)))), atol=2e-4)


def test_a_censored_threshold_has_no_curve(fabricate):
    record = pairs(fabricate)
    row = next(m for m in record.metrics if m.metric == "threshold_mm")
    row.censored = "<"
    assert fitted(record, np.array([7.0])) is None
    assert fitted(fabricate(), np.array([7.0])) is None
    (_, seen) = distance_panels(rows_of([record]), [], Looks(rows_of([record])), simulated=True)
    (figure,) = figures(seen)
    assert [trace["mode"] for trace in figure.data] == ["lines+markers"]
    assert figure.rows[0][1] == "< 8.40"


def test_points_of_the_figures_are_the_rows_own_values(fabricate):
    rows = rows_of([pairs(fabricate, seed=0), pairs(fabricate, seed=1, share=0.3)])
    errors, seen = distance_panels(rows, [], Looks(rows), simulated=True)
    for figure, metric in zip(
        figures(errors), ("distance_mae_mm", "distance_penalised_mm"), strict=True
    ):
        (trace,) = figure.data
        pooled = [rows[0].metric(metric, d) for d in DISTANCES]
        assert trace["y"] == rounded([p.value for p in pooled])
        assert trace["error_y"]["array"] == rounded([p.high - p.value for p in pooled])
        assert len(figure.rows) == len(DISTANCES)
    points = figures(seen)[0].data[0]
    assert points["y"] == rounded([100 * rows[0].metric("resolved", d).value for d in DISTANCES])
    for figure in [*figures(errors), *figures(seen)]:
        valid(figure)


def test_the_frontier_has_a_point_a_row_on_a_machine(fabricate):
    records = [
        fabricate(p90_ms=6.0, error=0.05),
        fabricate(model="cnn", p90_ms=3.0, error=0.09),
        fabricate(model="slow", p90_ms=20.0, error=0.5),
        fabricate(model="other", machine="ba9876543210"),
    ]
    rows = rows_of(records)
    panel = frontier_panel(rows, RANKING["exp1"], Looks(rows))
    assert [len(option.figures[0].data) - 1 for option in panel.options] == [3, 1]
    first = panel.options[0].figures[0]
    by = {trace["name"]: trace for trace in first.data if "name" in trace}
    assert by["cnn + hertz"]["x"] == [3.0]
    assert by["slow + hertz"]["marker"]["symbol"].endswith("-open")
    assert not by["unet + hertz"]["marker"]["symbol"].endswith("-open")
    assert "missed 1.00 %" in by["cnn + hertz"]["hovertext"][0]
    valid(first)
    assert frontier_panel([], RANKING["exp1"], Looks([])) is None


def test_looks_differ_in_more_than_colour(fabricate):
    rows = rows_of([fabricate(model=m, regime=r) for m in "abc" for r in ("single", "multiple")])
    looks = [Looks(rows).of(row) for row in rows]
    assert len({(look.symbol, look.dash) for look in looks}) == len(rows)
    assert Looks(rows).of(rows[0]) == Looks(rows).of(rows[0])


def exp1_answers():
    parts = contact_parts(frames=300)
    return of("exp1", parts)


def test_errors_of_single_presses_are_those_of_the_top_answer():
    found = errors_of(exp1_answers())
    assert np.isnan(found.error[3])
    np.testing.assert_allclose(np.delete(found.error, 3), 0.05)


@pytest.mark.parametrize("protocol", ["exp2", "exp3"])
def test_errors_of_several_contacts_agree_with_the_metrics(protocol):
    parts = pair_parts()
    if protocol == "exp3":
        parts["truth"]["group"] = np.array(["dual"] * 30)
    found = of(protocol, parts)
    values = errors_of(found).error
    names = ["position_mean_mm", "missed"]
    rows = {
        row.metric: row
        for row in score(names, found.trials, rng=np.random.default_rng(0))
        if row.group == "all"
    }
    assert np.nanmean(values) == pytest.approx(rows["position_mean_mm"].value)
    assert np.isnan(values).mean() == pytest.approx(rows["missed"].value)


def test_cells_of_the_map_average_to_the_whole(fabricate):
    one = exp1_answers()
    (row,) = rows_of([fabricate()])
    panel = error_maps([row], lambda _: one)
    error, missed = figures(panel)
    (trace,) = error.data
    counts = np.array([[cell[3] for cell in line] for line in trace["customdata"]])
    assert counts.shape == (CELLS, CELLS)
    assert counts.sum() == 300
    known = [z for line in trace["z"] for z in line if z is not None]
    np.testing.assert_allclose(known, 0.05, rtol=1e-3)
    share = np.array([[z or 0.0 for z in line] for line in missed.data[0]["z"]])
    assert (share * counts).sum() / 100 == pytest.approx(1, abs=0.01)
    valid(error)
    valid(missed)
    assert "0.33 %" in panel.options[0].note


def test_no_map_where_there_are_no_answers(fabricate):
    (row,) = rows_of([fabricate(seed=0), fabricate(seed=1)])
    assert error_maps([row], lambda _: None) is None


def test_the_worst_frame_is_the_unanswered_one():
    found = exp1_answers()
    errors = frame_errors(found, found.trials)
    assert int(np.argmax(errors)) == 3
    assert errors[0] == pytest.approx(0.05 / 3)
    parts = pair_parts()
    parts["truth"]["group"] = np.array(["catch", *parts["truth"]["group"][1:]])
    several = of("exp2", parts)
    errors = frame_errors(several, several.trials)
    assert errors[0] == -np.inf
    assert errors[1] == pytest.approx(2 * np.hypot(0.1, 0.1))
    assert errors[2] == pytest.approx(np.hypot(0.1, 0.1) + KEYS["exp2"].test.gate_mm / 2)


@pytest.mark.parametrize("values", [[1.0], [0.003, 4.0], [1e-4, 1e4], [3.1, 3.3]])
def test_a_logarithmic_axis_holds_its_values_and_has_ticks(values):
    made = log_axis("x", values)
    low, high = (10.0**end for end in made["range"])
    assert low < min(values) <= max(values) < high
    assert sum(low <= tick <= high for tick in made["tickvals"]) >= 1 + (max(values) > min(values))
    assert len(made["tickvals"]) == len(made["ticktext"])
