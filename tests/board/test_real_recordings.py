"""Real recordings on one page: shares of guessing, names, and the order of simulated boards."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tactibench.board import Agreement, PooledMetric, agreement, real_tests, simulated_orders
from tactibench.report import real_page


def on_recording(fabricate, model, error, sha256="ab" * 32, sensor="", **more):
    record = fabricate("surface", model, regime="recorded", origin="real", error=error, **more)
    record.sensor.recording = (
        type(record.sensor)
        .model_fields["recording"]
        .annotation.__args__[0](label="my folder", sha256=sha256, sensor=sensor)
    )
    record.identity.data = [sha256]
    return record


def order(models, spread=0.0):
    """Models in their order, with errors 1, 2, 3 and so on, each with this standard error."""
    half = 1.96 * spread
    return {
        name: PooledMetric(k, k - half, k + half, None, (9, 9), "mm")
        for k, name in enumerate(models, start=1)
    }


@pytest.mark.parametrize(
    ("one", "other", "tau"),
    [
        ("abcd", "abcd", 1.0),
        ("abcd", "dcba", -1.0),
        ("abcd", "abdc", 2 / 3),  # five of six pairs in one order, one in the other
        ("abcd", "badc", 1 / 3),
        ("abcde", "xbacd", 2 / 3),  # over the four that both have
        ("abc", "abc", None),
    ],
)
def test_tau_counts_pairs_in_the_same_order(one, other, tau):
    found = agreement(order(one), order(other))
    if tau is None:
        assert found is None
    else:
        same = pytest.approx(tau)  # errors without a spread leave the order as it is
        assert found == Agreement(same, same, same, len(set(one) & set(other)))


def test_the_interval_of_tau_is_that_of_the_errors():
    sure, unsure, none = (agreement(order("abcdef", s), order("abcdef", s)) for s in (0.1, 1, 50))
    assert (sure.low, sure.high) == (1.0, 1.0)
    assert unsure.low < 0.7
    assert unsure.high == 1.0
    # Without any order, 94 % of the tau of six models lie between -0.6 and 0.6 (Kendall 1938).
    steps = pytest.approx(0.6, abs=0.14), pytest.approx(-0.6, abs=0.14)
    assert (none.high, none.low) == steps
    seeds = {k: replace(e, sd=3.0, seeds=9) for k, e in order("abcdef").items()}  # 3 / sqrt(9)
    assert agreement(seeds, seeds) == unsure


def test_a_value_is_a_share_of_guessing(fabricate):
    records = [
        on_recording(fabricate, "mean", 0.8),
        *(on_recording(fabricate, "pins", error, seed=k) for k, error in enumerate((0.1, 0.3))),
    ]
    (test,) = real_tests({"surface": records})
    assert test.recording == "my folder"
    assert test.share("pins") == pytest.approx(0.25)
    assert test.share("mean") == 1.0
    assert test.share("cnn") is None
    assert test.order["pins"].value == pytest.approx(0.2)


def test_without_a_guess_there_is_no_share(fabricate):
    (test,) = real_tests({"surface": [on_recording(fabricate, "pins", 0.1)]})
    assert test.share("pins") is None
    (errors,) = real_page({"surface": [on_recording(fabricate, "pins", 0.1)]}).tables
    assert errors.rows[0][-1] == "0.1000 mm, 0.0900 – 0.1100"


@pytest.mark.parametrize(("second", "close"), [(0.13, 0), (0.12, 1)])
def test_the_page_says_where_chance_may_decide(fabricate, second, close):
    records = [
        on_recording(fabricate, model, error)  # with an interval of 10 % to either side
        for model, error in (("mean", 0.8), ("pins", 0.1), ("kernel", second), ("cnn", 0.4))
    ]
    page = real_page({"surface": records})
    chance = " On 1 of them the 95 % intervals of the first two models overlap, so that chance may"
    assert page.result == "The smallest error of 1 test: pins on 1." + close * f"{chance} decide."
    (errors,) = page.tables
    assert errors.rows[0][-1].below == "0.1000 mm, 0.0900 – 0.1100"


def test_a_recording_is_called_by_its_sensor_or_by_the_name_that_is_known(fabricate):
    names = {"": "my folder", "eFlesh": "eFlesh"}
    for sensor, name in names.items():
        record = on_recording(fabricate, "pins", 0.1, sensor=sensor)
        assert real_tests({"surface": [record]})[0].recording == name
    record = on_recording(fabricate, "pins", 0.1, sha256="4bfc6b93" + 56 * "0")
    assert "331 pins" in real_tests({"surface": [record]})[0].recording


def test_rows_at_other_settings_and_of_simulated_sensors_stay_away(fabricate):
    records = [
        on_recording(fabricate, "pins", 0.1),
        on_recording(fabricate, "pins", 0.01, settings={"width": 8}),
        fabricate("surface", "cnn", error=0.01),
    ]
    (test,) = real_tests({"surface": records})
    assert {name: error.value for name, error in test.order.items()} == {"pins": 0.1}


def test_the_page_says_whether_simulated_boards_predict_the_order(fabricate):
    models = ("pins", "kernel", "cnn", "vgnn")
    real = [on_recording(fabricate, m, 0.1 + k) for k, m in enumerate(models)]
    simulated = [
        fabricate(
            "exp1",
            m,
            error=1.0 - k,
            metrics=(("gospa_depth_mm", "unseen", 0.1 + k), ("mae_mm", "z", 0.2 + k)),
        )
        for k, m in enumerate(models, start=-3)
    ]
    errors = {
        board: {name: error.value for name, error in found.items()}
        for board, found in simulated_orders(simulated).items()
    }
    assert errors == {
        "the simulated sensor of the training": {m: 4.0 - k for k, m in enumerate(models)},
        "the same, by the depth alone": {m: pytest.approx(k - 2.8) for k, m in enumerate(models)},
        "simulated sensors that no training saw": {
            m: pytest.approx(k - 2.9) for k, m in enumerate(models)
        },
    }
    page = real_page({"surface": real, "exp1": simulated})
    taus = {(row[1], row[2]): row[-1].text for row in page.tables[-1].rows}
    ours = "my folder (surface)"
    assert taus["the simulated sensor of the training", ours] == "-1.00"
    assert taus["simulated sensors that no training saw", ours] == "1.00"
    assert page.validity == (
        "Kendall's tau between the orders of models: -1.00 to 1.00 for a simulated board and a "
        "real recording."
    )
    assert "# Real recordings" in page.markdown()
    assert page.records == len(models)


def test_without_real_recordings_there_is_no_page(fabricate):
    assert real_page({"exp1": [fabricate("exp1", "pins")]}).tables == ()
