"""The pages: a pure function of what is committed; misses, published rows where they belong."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest
from changed_record import changed_record

from tactibench import UserError
from tactibench.board import (
    FOLDER,
    compact,
    gather_records,
    sections_of,
    select_section,
    trained_for,
)
from tactibench.metrics import all_metrics
from tactibench.protocols import board_spec, load_protocol, load_published, protocol_files
from tactibench.records import measured_on, text_of
from tactibench.report import board_page, board_rows, page_files, table_lines

ROOT = Path(__file__).resolve().parents[2]
MAIN = "Error, and off the nominal sensor"
"""Title of the first table of exp1."""
TITLE = r"^#{2,3} "
"""What stands before the title of a table."""
PUBLISHED = load_published(["tactiverse"], ROOT / "leaderboards" / "published")


def made(records, protocol="exp1"):
    """Everything that the report shows of a board."""
    page = board_page(load_protocol(protocol), records, PUBLISHED)
    parts = [page.intro]
    for section in page.sections:
        parts += [f"## {section.title}", *section.notes, *section.signatures]
        parts += [text for one in section.tables for text in written(one)]
    parts += ["## Published", *(text for one in page.published for text in written(one))]
    return "\n".join([*parts, "## Machines", *page.machines.values()])


def written(table):
    return [f"### {table.title}", *table_lines(table), " ".join(table.notes)]


def short(records, protocol="exp1"):
    """The page under leaderboards/."""
    return board_page(load_protocol(protocol), records, PUBLISHED).markdown()


def tables(text):
    """Title of every table -> its rows as a list of {head: cell}, by number where twice."""
    found = {}
    for part in re.split(TITLE, text, flags=re.MULTILINE)[1:]:
        lines = [line for line in part.split("\n") if line.startswith("| ")]
        rows = [[cell.strip() for cell in line[1:-1].split(" | ")] for line in lines]
        if rows:
            heads = [
                f"{head} {k}" if rows[0].count(head) > 1 else head for k, head in enumerate(rows[0])
            ]
            assert all(len(row) == len(heads) for row in rows), part
            title = html.unescape(part.split("\n")[0])
            found.setdefault(title, []).append(
                [dict(zip(heads, row, strict=True)) for row in rows[2:]]
            )
    return found


@pytest.mark.long
def test_the_committed_pages_are_what_the_committed_records_give():
    stale = [page.path.name for page in page_files(ROOT / "leaderboards") if not page.current]
    assert stale == [], "run `tactibench board` and commit"


@pytest.mark.long
def test_the_committed_pages_are_short_and_their_tables_have_seven_columns():
    pages = page_files(ROOT / "leaderboards")
    lengths = {page.path.name: len(page.text.splitlines()) for page in pages}
    assert sum(lengths.values()) <= 900
    assert max(lengths.values()) <= 100
    for page in pages:
        lines = [line for line in page.text.splitlines() if line.startswith("| ")]
        assert max(line.count(" | ") + 1 for line in lines) <= 7, page.path.name
        assert "threshold_" not in page.text


def test_a_short_page_has_a_result_and_one_row_of_each_model(fabricate):
    def unseen(value):
        return (("gospa_depth_mm", "unseen", value), ("mae_mm", "z", 0.02))

    text = short(
        [
            *(fabricate(error=0.05, seed=seed, metrics=unseen(0.9)) for seed in (0, 1)),
            fabricate(error=0.01, settings={"width": 8}),
            fabricate(error=0.03, regime="multiple"),
            fabricate("exp1", "cnn", encoder=None, error=0.2, metrics=unseen(0.4)),
            fabricate("exp1", "own", encoder=None, error=0.3, settings={"k": 1}),
            fabricate("exp1", "mean", encoder=None, error=0.001),
            fabricate(sensor={"instance": 3}),
        ]
    )
    assert (
        "**Simulated sensor tactip-127. Smallest GOSPA of 3 models: unet, 0.0500 mm. Smallest "
        "GOSPA on unseen sensors: cnn, 0.400 mm. Trained in regime multiple: unet, 0.0300 mm "
        "(below 0.05 mm it measures the simulator as much).**"
    ) in text
    found = tables(text)
    (rows,) = found["Simulated sensor tactip-127"]
    assert [row["model"] for row in rows] == [
        "unet",
        "cnn",
        "own, k=1<br><sub>as submitted</sub>",
        "*mean*",
    ]
    assert list(rows[0]) == [
        *("rank", "model", "GOSPA, mm", "error of the depth, mm", "GOSPA on unseen sensors, mm"),
        *("missed, %", "p90, ms"),
    ]
    (other,) = found["Simulated sensor tactip-127, trained in regime multiple"]
    assert [row["model"] for row in other] == ["unet (multiple)"]
    assert "board show exp1 --full" in text


def test_a_short_page_of_recordings_names_them_and_says_what_a_model_knew(fabricate):
    record = fabricate("surface", "own", encoder=None, origin="real", regime="recorded")
    record = changed_record(record, {"training.prior": "plain addition"})
    (rows,) = tables(short([record], "surface"))["Real recording: tactip-127"]
    assert rows[0]["model"] == "own<br><sub>knew addition, as submitted</sub>"


def test_the_order_of_the_records_does_not_matter(fabricate):
    records = [fabricate(model=m, seed=s, encoder=None) for m in ("cnn", "mean") for s in range(3)]
    assert made(records) == made(records[::-1]) == made(records[3:] + records[:3])


def test_a_row_shows_seeds_mean_interval_spread_misses_and_trivial_rows(fabricate):
    text = made(
        [
            fabricate(error=0.04, seed=0, metrics=(("mae_mm", "mean", 0.03),)),
            fabricate(error=0.06, seed=1, metrics=(("mae_mm", "mean", 0.05),)),
            fabricate(model="mean", encoder=None, error=2.0),
        ]
    )
    (rows,) = tables(text)[MAIN]
    assert [row["model"] for row in rows] == [
        "unet<br><sub>2 seeds, as submitted</sub>",
        "*mean*<br><sub>1 seed, as submitted</sub>",
    ]
    assert rows[0]["GOSPA, mm"] == "0.0500<br><sub>0.0450 – 0.0550</sub><br><sub>sd 0.0141</sub>"
    assert rows[0]["MAE, mm"] == "0.0400<br><sub>0.0360 – 0.0440</sub><br><sub>sd 0.0141</sub>"
    assert (rows[1]["MAE, mm"], rows[0]["missed, %"][:4]) == ("n/a", "1.00")
    assert "1,000 presses." in text


@pytest.mark.parametrize("protocol", sorted(protocol_files()))
def test_misses_stand_beside_every_error(protocol):
    # Of named places a missed one is an error already: the set is wrong.
    shares = {"missed", "resolved", "coverage", "exact", "told"}
    for block in board_spec(protocol).blocks:
        metrics = {column.metric for column in block.columns}
        shown = metrics | set(block.below.values())
        assert shown & shares or block.title.startswith("False contacts")
        assert metrics <= all_metrics().keys()


def test_sensors_have_sections_of_their_own_and_published_rows_too(fabricate):
    text = made([fabricate(), fabricate(sensor={"instance": 3}), fabricate(origin="real")])
    heads = [part.split("\n")[0] for part in re.split(TITLE, text, flags=re.MULTILINE)]
    places = [
        heads.index(head)
        for head in (
            "Simulated sensor tactip-127",
            "Simulated sensor tactip-127, instance=3",
            "Real sensor tactip-127",
            "Published",
            "Machines",
        )
    ]
    assert places == sorted(places)
    found = tables(text)
    assert [len(rows) for rows in found[MAIN]] == [1, 1, 1]
    assert [row["model"] for row in found["tactiverse"][0]] == ["CNN", "U-Net"]
    assert found["tactiverse"][0][0]["MAE, mm, mean"] == "0.0612"
    assert "Measured on: hardware TacTip" in text.partition("## Published")[2]


def test_signatures_stand_below_and_cost_is_split_by_machine(fabricate):
    efficiency = {"parameters": 1930000, "flops_per_frame": 2.1e9, "peak_memory_mb": 412.4}
    records = [
        fabricate(seed=0, p90_ms=2.0, efficiency=efficiency),
        fabricate(seed=1, p90_ms=4.0, efficiency=efficiency),
        fabricate(seed=2, p90_ms=9.0, machine="ba9876543210"),
    ]
    text = made(records)
    ((two, one),) = tables(text)["Speed and cost"]
    assert two["p90, ms"] == "3.00<br><sub>sd 1.4</sub>"
    assert [two[name] for name in ("weights", "operations", "memory, MB", "training")] == [
        *("1.93 M", "2.1 G", "412", "4 min 0 s")
    ]
    assert (one["p90, ms"], one["weights"]) == ("9.00", "n/a")
    assert (two["machine"], one["machine"]) == ("`0123456789ab`", "`ba9876543210`")
    assert all(record.signature in text for record in records)


def test_fewer_presses_stand_in_the_curve_only(fabricate):
    few = fabricate(error=0.2, limits={"presses": 250}, data={"train": 250})
    found = tables(made([fabricate(), few]))
    assert len(found[MAIN][0]) == 1
    (curve,) = found["Learning curve"][0]
    assert list(curve) == ["model", "250", "3,600"]
    assert curve["250"] == "0.2000<br><sub>0.1800 – 0.2200</sub>"
    assert "Learning curve" not in tables(made([fabricate()]))


def test_the_share_of_resolved_pairs_stands_below_the_error_of_a_distance(fabricate):
    rows = (("distance_penalised_mm", "6.5", 1.25), ("resolved", "6.5", 0.5))
    found = tables(made([fabricate("exp2", metrics=rows)], "exp2"))
    cell = found["Penalised error by true distance, mm"][0][0]["6.5"]
    assert cell == "1.25<br><sub>50 %</sub>"


def test_no_markup_of_a_record_reaches_the_page(fabricate):
    evil = "<img src=x onerror=alert(1)>|`*_[a](b)"
    record = fabricate(signature="x```\n<script>y", regime=evil)
    record.environment.cpu = evil
    text = short([record])
    assert "<img" not in text.replace("\\<img", "")
    assert "```\n<script>" not in text


def test_an_empty_board_says_how_to_fill_it():
    assert "tactibench board add RUN" in short([])


def test_records_of_an_unknown_protocol_are_refused(tmp_path, fabricate):
    record = compact(fabricate())
    folder = tmp_path / FOLDER / "exp9"
    folder.mkdir(parents=True)
    (folder / f"{record.name}.json").write_text(text_of(record))
    with pytest.raises(UserError, match=r"'exp9', which is not installed; .* TACTIBENCH_PROTOCOLS"):
        page_files(tmp_path)
    with pytest.raises(UserError, match="there is no folder"):
        page_files(tmp_path / "nowhere")


def test_the_tidy_rows_hold_what_the_tables_show(tmp_path, fabricate):
    for seed, error in enumerate((0.04, 0.06)):
        record = compact(fabricate(error=error, seed=seed))
        path = tmp_path / FOLDER / "exp1" / f"{record.name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text_of(record))
    tidy = board_rows(tmp_path)
    rows = {(row["metric"], row["group"]): row for row in tidy}
    assert rows["gospa_depth_mm", "all"]["value"] == pytest.approx(0.05)
    assert rows["gospa_depth_mm", "all"]["seeds"] == [0, 1]
    assert rows["p90_ms", "0123456789ab"]["value"] == pytest.approx(6.0)


def test_seeds_that_have_a_limit_alone_stand_in_the_table_and_in_the_tidy_rows(tmp_path, fabricate):
    records = []
    for seed, value in enumerate((8.0, 9.0, 12.0)):
        record = fabricate("exp2", seed=seed, metrics=(("threshold_mm", "all", value),))
        next(m for m in record.metrics if m.metric == "threshold_mm").censored = (
            ">" if value == 12.0 else None
        )
        records.append(compact(record))
        path = tmp_path / FOLDER / "exp2" / f"{record.name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text_of(records[-1]))
    assert "1 of 3 seeds &gt; 12" in made(records, "exp2")
    (row,) = (row for row in board_rows(tmp_path) if row["metric"] == "threshold_mm")
    assert (row["value"], row["limits"]) == (8.5, "1 of 3 seeds > 12")


def test_a_comparison_with_released_predictions_has_a_table_of_its_own(fabricate):
    title = "Against the released predictions, frame for frame"
    plain = fabricate("surface", "own", encoder=None, origin="real")
    assert title not in tables(made([plain], "surface"))
    rows = (
        ("depth_mae_minus_published_mm", "tac-vgnn", -0.03),
        ("depth_mae_minus_published_p", "tac-vgnn", 1e-4),
        ("coverage", "all", 1.0),
    )
    compared = fabricate("surface", "pins", encoder=None, origin="real", metrics=rows)
    text = made([plain, compared], "surface")
    found = {row["model"].split()[0]: row for row in tables(text)[title][0]}
    assert found["pins"]["depth MAE, mm"].startswith("-0.0300<br>")
    assert "cnn" not in found  # its answers were not compared
    assert "below zero where this row is nearer to the label" in text


def test_a_row_below_the_cramer_rao_bound_is_marked(fabricate):
    plain, exact = made([fabricate()]), made([fabricate(metrics=(("rmse_over_bound", "x", 0.5),))])
    assert "†" not in plain
    assert "unet †" in exact
    assert "†: more exact than the Cramer-Rao bound" in exact


def other_test(name, description, asked, presses, **parameters):
    facts = {"name": name, "on": description, "asked": [asked], "presses": presses}
    return {**facts, "parameters": parameters}


REFERENCE = other_test("tactip-127-fem", "finite-element scenes", "reference", 7, noise=True)
OTHER = other_test(
    "tactip-127", "another individual (instance=1)", "sensor.instance=1", 1000, instance=1
)


@pytest.fixture
def tested(fabricate):
    def made(on, test=1000, **more):
        record = fabricate(**more)
        return changed_record(
            record,
            {
                "sensor.tested": on,
                "identity.data": [on["on"]],
                "data.test": test,
                "name": f"{record.name}-{on['name']}-{on['presses']}",
            },
        )

    return made


@pytest.fixture
def records(fabricate, tested):
    return [
        tested(OTHER),
        tested(REFERENCE, 35),
        fabricate(),
        fabricate(sensor={"instance": 1}),
        tested(OTHER, seed=1),
        tested(REFERENCE, 35, model="mean", encoder=None),
    ]


def test_they_follow_the_sensor_and_never_share_a_table(records):
    sections = sections_of(records)
    assert [section.nominal for section in sections] == [True, False, False, False]
    assert [section.title for section in sections] == [
        "Simulated sensor tactip-127",
        "Simulated sensor tactip-127, instance=1",
        "Simulated sensor tactip-127, tested on another individual (instance=1)",
        "Simulated sensor tactip-127, tested on finite-element scenes",
    ]
    assert [len(section.rows) for section in sections] == [1, 1, 1, 2]
    assert sections[2].rows[0].seeds == (0, 1)


def test_the_page_says_how_many_frames(records):
    text = made(records)
    part = text.partition("## Simulated sensor tactip-127, tested on finite-element scenes")[2]
    assert part
    assert "tested on 35 frames of 7 presses: `--test reference`." in part
    assert "tested on 1,000 presses: `--test sensor.instance=1`." in text
    assert "Speed and cost" not in part.partition("## Simulated")[0]
    assert made(records[::-1]) == text


def test_curves_and_frontiers_leave_them_out(records, tmp_path):
    folder = tmp_path / FOLDER / "exp1"
    folder.mkdir(parents=True)
    for record in records:
        (folder / f"{record.name}.json").write_text(text_of(record), encoding="utf-8")
    found = gather_records("exp1", tmp_path, None)
    assert len(found) == 2
    assert select_section(found, None, "exp1").nominal
    assert trained_for(records) == [records[2], records[3]]


def moved(tested, source, target, **more):
    on = other_test("recorded", f"recording {target}", f"data={target}", 1000, labels="auto")
    record = tested({**on, "trained_on": source}, **more)
    return changed_record(record, {"data.of_tested_sensor": {"left_out_calibrated": 42}})


def test_every_pair_of_sensors_has_a_table_and_says_what_was_simulated(tested):
    pairs = [
        ("real recording tac/331", "tac/127"),
        ("real recording tac/127", "tac/331"),
        ("simulated fitted-127", "tac/127"),
    ]
    records = [
        moved(tested, *pair, protocol="transfer", model=model, encoder=None)
        for pair in pairs
        for model in ("pins", "kernel")
    ]
    sections = sections_of(records)
    assert {section.title for section in sections} == {
        "Real recording tac/127, trained on real recording tac/331",
        "Real recording tac/331, trained on real recording tac/127",
        "Real recording tac/127, trained on simulated fitted-127",
    }
    assert all(len(section.rows) == 2 for section in sections)
    assert measured_on(records[-1]) == "real recording tac/127, trained on simulated fitted-127"
    text = made(records, "transfer")
    assert "fitted to 0 labelled frames, the simulated sensor to 42 others" in text
