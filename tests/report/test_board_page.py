"""The pages: a pure function of what is committed; misses, published rows where they belong."""

from __future__ import annotations

import html
import re
from pathlib import Path

import pytest

from tactibench import UserError
from tactibench.board import FOLDER, compact, text_of
from tactibench.metrics import FAMILIES
from tactibench.protocols import load_protocol, load_published, protocol_files
from tactibench.protocols.board_spec import board_spec
from tactibench.report import page_files, tidy_rows
from tactibench.report.board_page import board_page

ROOT = Path(__file__).resolve().parents[2]
MAIN = "Error, and off the nominal sensor"
"""Title of the first table of exp1."""
TITLE = r"^(?:#{2,3} |<details[^>]*><summary>)"
"""What stands before the title of a table, shown or folded."""
PUBLISHED = load_published(["tactiverse"], ROOT / "leaderboards" / "published")


def made(records, protocol="exp1"):
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
            title = html.unescape(part.split("\n")[0].removesuffix("</summary>"))
            found.setdefault(title, []).append(
                [dict(zip(heads, row, strict=True)) for row in rows[2:]]
            )
    return found


def test_the_committed_pages_are_what_the_committed_records_give():
    stale = [page.path.name for page in page_files(ROOT / "leaderboards") if not page.current]
    assert stale == [], "run `tactibench board` and commit"


def test_a_protocol_without_records_has_no_page_unless_it_had_one(tmp_path):
    (tmp_path / "submissions").mkdir()
    assert page_files(tmp_path) == []
    (tmp_path / "fine.md").write_text("a row was here")
    (page,) = page_files(tmp_path)
    assert (page.path.name, page.records, page.current) == ("fine.md", 0, False)


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
    assert [row["model"] for row in rows] == ["unet", "*mean*"]
    assert (rows[0]["seeds"], rows[1]["seeds"]) == ("2", "1 seed")
    assert rows[0]["GOSPA, mm"] == "0.0500<br><sub>0.0450 – 0.0550</sub>"
    assert rows[0]["MAE, mm"] == "0.0400<br><sub>0.0360 – 0.0440</sub>"
    assert rows[0]["sd 7"] == rows[0]["sd 9"] == "0.0141"
    assert (rows[1]["sd 7"], rows[1]["MAE, mm"], rows[0]["missed, %"]) == ("n/a", "n/a", "1.00")
    (axes,) = tables(text)["By axis"]
    assert axes[0]["R2"] == "n/a"
    assert "Trivial rows are missing: `tactibench run exp1 --model nearest`" in text
    assert "1,000 presses." in text


def test_prior_knowledge_and_mixing_have_a_column_of_their_own(fabricate):
    (rows,) = tables(made([fabricate(settings={"mixing": 1.0, "width": 8})]))[MAIN]
    assert (rows[0]["model"], rows[0]["prior knowledge"]) == (
        "unet, width=8",
        "not stated, mixing 1",
    )


@pytest.mark.parametrize("protocol", sorted(protocol_files()))
def test_misses_stand_beside_every_error(protocol):
    shares = {"missed", "resolved", "coverage"}
    for block in board_spec(protocol).blocks:
        metrics = {column.metric for column in block.columns}
        shown = metrics | set(block.below.values())
        assert shown & shares or block.title.startswith("False contacts")
        assert metrics <= set(FAMILIES)


def test_sensors_have_sections_of_their_own_and_published_rows_too(fabricate):
    text = made([fabricate(), fabricate(sensor={"instance": 3}), fabricate(origin="real")])
    heads = [part.split("\n")[0] for part in re.split(TITLE, text, flags=re.MULTILINE)]
    places = [
        heads.index(head)
        for head in (
            "Simulated sensor tactip-127",
            "Simulated sensor tactip-127, instance=3: a perturbed individual</summary>",
            "Real sensor tactip-127</summary>",
            "Published",
            "Machines</summary>",
        )
    ]
    assert places == sorted(places)
    found = tables(text)
    assert [len(rows) for rows in found[MAIN]] == [1, 1, 1]
    assert [row["model"] for row in found["tactiverse"][0]] == ["CNN", "U-Net"]
    assert found["tactiverse"][0][0]["MAE, mm, mean"] == "0.0612"
    assert "Measured on: hardware TacTip" in text.partition("## Published")[2]


def test_signatures_stand_below_and_cost_is_split_by_machine(fabricate):
    records = [
        fabricate(seed=0, p90_ms=2.0),
        fabricate(seed=1, p90_ms=4.0),
        fabricate(seed=2, p90_ms=9.0, machine="ba9876543210"),
    ]
    text = made(records)
    (rows,) = tables(text)["Latency"]
    assert [(row["seeds"], row["p90, ms"], row["machine"]) for row in rows] == [
        ("2", "3.00", "`0123456789ab`"),
        ("1 seed", "9.00", "`ba9876543210`"),
    ]
    (cost,) = tables(text)["Cost"]
    assert (cost[0]["weights"], cost[0]["training"]) == ("n/a", "4 min 0 s")
    assert all(record.signature in text for record in records)
    assert "Signatures of 3 runs" in text


def test_efficiency_is_shown_where_it_was_measured(fabricate):
    efficiency = {"parameters": 1930000, "flops_per_frame": 2.1e9, "peak_memory_mb": 412.4}
    timed = {"configuration": "bf16, batch 1", "difference_mm": 0.00213}
    record = fabricate(efficiency=efficiency, timed=timed)
    record.speed[0].settled = False
    found = tables(made([record]))
    (cost,), (latency,) = found["Cost"][0], found["Latency"][0]
    assert [cost[name] for name in ("weights", "operations", "memory, MB")] == [
        "1.93 M",
        "2.1 G",
        "412",
    ]
    assert latency["p90, ms"] == "6.00\\*"
    assert (latency["to float32, mm"], latency["timed as"]) == ("0.0021", "bf16, batch 1")


@pytest.mark.parametrize(
    ("stolen", "foreign", "shown"),
    [(0.0, 0.09, "6.00"), (0.0, 0.5, "6.00\\*"), (0.2, 0.0, "6.00\\*"), (None, None, "6.00")],
)
def test_a_board_judges_the_load_of_a_time_itself(fabricate, stolen, foreign, shown):
    record = fabricate()
    for speed in record.speed:
        speed.stolen, speed.foreign = stolen, foreign
    (latency,) = tables(made([record]))["Latency"][0]
    assert all(speed.settled for speed in record.speed)
    assert latency["p90, ms"] == shown


def test_the_commits_are_named_and_changed_code_is_said(fabricate):
    records = [fabricate(seed=seed) for seed in range(3)]
    for record in records[:2]:
        record.identity.commit = "98fe4aa45a4d3fbda2e9"
    records[2].identity.commit = "98fe4aa45a4d3fbda2e9+dirty"
    said = "`98fe4aa45a` (2); `98fe4aa45a`, with uncommitted changes (1)."
    assert f"Runs by commit of tactibench: {said}" in made(records)


def test_fewer_presses_stand_in_the_curve_only(fabricate):
    few = fabricate(error=0.2, limits={"presses": 250}, data={"train": 250})
    found = tables(made([fabricate(), few]))
    assert len(found[MAIN][0]) == 1
    (curve,) = found["Learning curve"][0]
    assert list(curve) == ["model", "250", "3,600"]
    assert curve["250"] == "0.2000<br><sub>0.1800 – 0.2200</sub><br><sub>1 seed</sub>"
    assert "Learning curve" not in tables(made([fabricate()]))


def test_optional_tables_appear_with_their_metrics(fabricate):
    bound = tuple(("rmse_over_bound", axis, 5.0) for axis in "xyz")
    assert "RMSE over the Cramer-Rao bound" in tables(made([fabricate(metrics=bound)]))
    assert "RMSE over the Cramer-Rao bound" not in tables(made([fabricate()]))
    assert "Stated uncertainty" in tables(made([fabricate(metrics=(("nll", "all", -3.0),))]))


def test_what_several_tables_share_is_said_once(fabricate):
    text = made([fabricate(), fabricate(sensor={"instance": 3})])
    assert len(tables(text)[MAIN]) == 2
    assert text.count("mean over x, y and depth of the best-scored prediction") == 1
    assert text.count("Rank: rows share one") == 1
    assert text.count("Operations: floating-point") == 1
    assert text.count("1,000 presses.") == 2  # once a sensor


def test_the_share_of_resolved_pairs_stands_below_the_error_of_a_distance(fabricate):
    rows = (("distance_penalised_mm", "6.5", 1.25), ("resolved", "6.5", 0.5))
    found = tables(made([fabricate("exp2", metrics=rows)], "exp2"))
    cell = found["Penalised error by true distance, mm"][0][0]["6.5"]
    assert cell == "1.25<br><sub>50 %</sub>"


def test_lapses_are_in_per_cent_and_rejected_fits_are_counted_by_seed(fabricate):
    def trained(seed, lapse, method):
        metrics = (("threshold_mm", "all", 9.0), ("threshold_lapse", "all", lapse))
        record = fabricate("exp2", seed=seed, metrics=metrics)
        found = [
            metric.model_copy(update={"method": method})
            if metric.metric == "threshold_mm"
            else metric
            for metric in record.metrics
        ]
        return record.model_copy(update={"metrics": found})

    seeds = [trained(0, 0.05, None), trained(1, 0.06, "interpolated"), trained(2, 0.1, None)]
    ((row,),) = tables(made(seeds, "exp2"))["Two-point threshold"]
    assert (row["lapses, %"], row["fit rejected, of seeds"]) == ("7.0", "1 of 3")
    ((row,),) = tables(made([fabricate("exp2")], "exp2"))["Two-point threshold"]
    assert (row["lapses, %"], row["fit rejected, of seeds"]) == ("n/a", "n/a")


def test_no_markup_of_a_record_reaches_the_page(fabricate):
    evil = "<img src=x onerror=alert(1)>|`*_[a](b)"
    record = fabricate(signature="x```\n<script>y", regime=evil)
    record.environment.cpu = evil
    text = made([record])
    assert "<img" not in text.replace("\\<img", "")
    assert "```\n<script>" not in text


def test_an_empty_board_says_how_to_fill_it():
    assert "tactibench board add RUN" in made([])
    assert made([]).endswith("\n")


def test_records_of_an_unknown_protocol_are_refused(tmp_path, fabricate):
    record = compact(fabricate())
    folder = tmp_path / FOLDER / "exp9"
    folder.mkdir(parents=True)
    (folder / f"{record.name}.json").write_text(text_of(record))
    with pytest.raises(UserError, match=r"'exp9', which is not installed; .* TACTIBENCH_PROTOCOLS"):
        page_files(tmp_path)
    with pytest.raises(UserError, match="there is no board in"):
        page_files(tmp_path / "nowhere")


def test_the_tidy_rows_hold_what_the_tables_show(tmp_path, fabricate):
    for seed, error in enumerate((0.04, 0.06)):
        record = compact(fabricate(error=error, seed=seed))
        path = tmp_path / FOLDER / "exp1" / f"{record.name}.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text_of(record))
    rows = {(row["metric"], row["group"]): row for row in tidy_rows(tmp_path)}
    assert rows["gospa1_mm", "all"]["value"] == pytest.approx(0.05)
    assert rows["gospa1_mm", "all"]["seeds"] == [0, 1]
    assert rows["p90_ms", "0123456789ab"]["value"] == pytest.approx(6.0)


def test_a_comparison_with_released_predictions_has_a_table_of_its_own(fabricate):
    title = "Against the released predictions, frame for frame"
    plain = fabricate("surface", "cnn", encoder=None, origin="real")
    assert title not in tables(made([plain], "surface"))
    rows = (
        ("depth_mae_minus_published_mm", "tac-vgnn", -0.03),
        ("depth_mae_minus_published_p", "tac-vgnn", 1e-4),
        ("coverage", "all", 1.0),
    )
    compared = fabricate("surface", "pins", encoder=None, origin="real", metrics=rows)
    text = made([plain, compared], "surface")
    found = {row["model"]: row for row in tables(text)[title][0]}
    assert found["pins"]["depth MAE, mm"].startswith("-0.0300<br>")
    assert found["cnn"]["depth MAE, mm"] == "n/a"
    assert "below zero where this row is nearer to the label" in text


def test_a_row_below_the_cramer_rao_bound_is_marked(fabricate):
    plain, exact = made([fabricate()]), made([fabricate(metrics=(("rmse_over_bound", "x", 0.5),))])
    assert "unet †" not in plain
    assert "| unet † |" in exact
    assert "†: more exact than the Cramer-Rao bound" in exact
