"""A run as it is printed: complete, readable at 80 columns, honest about the origin of numbers."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tactibench.protocols.board_spec import board_spec
from tactibench.records import AdaptedSensor
from tactibench.report import labels_line, metric_number, partial_line

PROTOCOLS = ["exp1", "exp2", "exp3", "surface"]


def numbers(text: str) -> set[str]:
    return set(re.findall(r"\d[\d,.]*\d|\d", text))


@pytest.mark.parametrize("width", [80, 100, 120])
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_nothing_is_cut_and_tables_keep_to_the_width(
    record: Any, render: Any, protocol: str, width: int
) -> None:
    shown = record(protocol)
    text = render(shown, width, [record(protocol, name="other", regime="multiple")])
    assert "…" not in text
    long = {
        shown.signature,
        f"record: experiments/of/a/long/name/tactile/runs/{shown.name}/record.json",
    }
    assert long < set(text.splitlines())
    assert all(len(line) <= width for line in text.splitlines() if line not in long)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_metric_is_shown_with_its_interval(record: Any, render: Any, protocol: str) -> None:
    shown = record(protocol)
    for k, one in enumerate(shown.metrics):  # so that no row can stand in for another
        one.value, one.low, one.high = (start + k / 100 for start in (0.3017, 0.2917, 0.3117))
    text = " ".join(render(shown, 120).split())
    for one in shown.metrics:
        if one.censored:
            continue
        options = {str(metric_number(one, decimals) or "n/a") for decimals in range(5)}
        assert any(option in text for option in options), one


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_terminal_that_is_too_narrow_loses_no_number(
    record: Any, render: Any, protocol: str
) -> None:
    def unbroken(width: int) -> set[str]:
        shown = record(protocol, name="r", signature="s")
        return numbers(render(shown, width))

    assert unbroken(50) == unbroken(80)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_measured_and_published_rows_stand_under_their_origin(
    record: Any, render: Any, protocol: str
) -> None:
    text = render(record(protocol))
    lines = text.splitlines()
    origin = "real sensor recorded" if protocol == "surface" else "simulated sensor tactip-127"
    measured = [k for k, line in enumerate(lines) if line.startswith("measured here:")]
    papers = [k for k, line in enumerate(lines) if line.startswith("published: hardware TacTip")]
    assert all(origin in lines[k] for k in measured)
    assert len(papers) == 1
    (compared,) = [part for part in text.split("\n\n") if "published: hardware TacTip" in part]
    assert compared.rindex("measured here:") < compared.index("published: hardware TacTip")


@pytest.mark.parametrize("protocol", ["exp1", "exp2", "exp3"])
def test_tests_apart_have_a_table_where_they_were_pressed(
    record: Any, render: Any, protocol: str
) -> None:
    """Not so in a quick run, and on a sensor that has no instances."""
    title = board_spec(protocol).run_tables[-1].title
    shown = record(protocol)
    assert title in render(shown)
    shown.metrics = [
        m for m in shown.metrics if m.group.partition(":")[0] not in board_spec(protocol).apart
    ]
    assert title not in render(shown)


def test_published_values_have_the_digits_of_the_paper(record: Any, render: Any) -> None:
    text = render(record("exp1"))
    assert re.search(r"^x +0\.9994 +0\.0713 +0\.0908 *$", text, re.M)  # CNN
    assert re.search(r"^mean +0\.9972 +0\.0589 +0\.1282 *$", text, re.M)  # U-Net
    plate = render(record("surface"))
    assert re.search(r"^all +0\.0552 +1\.011 +96\.8 +1,210 *$", plate, re.M)
    assert re.search(r"^dual +2\.24 +0\.71 +n/a +725 *$", render(record("exp3")), re.M)


def test_a_simulated_run_is_never_called_comparable(record: Any, render: Any) -> None:
    shown = record("surface")
    assert "Comparable: Frame for frame" in render(shown)
    shown.sensor.origin = "simulated"
    assert "Not comparable (simulated here): Frame for frame" in render(shown)


def test_other_test_frames_are_never_called_comparable(record: Any, render: Any) -> None:
    shown = record("surface")
    shown.data.published_frames = False
    assert "Comparable: Frame for frame" not in render(shown)
    assert "not tested on the published test frames" in " ".join(render(shown).split())


def test_a_model_that_resolves_nothing_shows_na_and_its_misses(
    exp2: Any, record: Any, render: Any
) -> None:
    text = render(record("exp2", metrics=exp2(resolved=0.0)))
    assert re.search(r"^6\.5 +0 \[0, 7\] +n/a +6\.50 \[6\.10, 6\.90\] +n/a +0/100", text, re.M)
    assert "None" not in text
    assert "nan" not in text


def test_a_censored_threshold_is_a_limit(row: Any, record: Any, render: Any) -> None:
    assert re.search(r"two-point threshold \(75 %\), mm +< 6\.5 ", render(record("exp2")))
    bound = row("threshold_mm", "all", 12.0, censored=">")
    assert str(metric_number(bound, 1)) == "> 12.0"


@pytest.mark.parametrize(
    ("limits", "line"),
    [
        ({"quick": True, "limit": None}, "PARTIAL (quick): not for a board"),
        ({"quick": False, "limit": 50}, "PARTIAL (limit 50): not for a board"),
        ({"quick": True, "limit": 50}, "PARTIAL (quick, limit 50): not for a board"),
        ({"quick": False, "limit": None}, "PARTIAL: not for a board"),
    ],
)
def test_a_partial_run_says_so_above_and_below(
    record: Any, render: Any, limits: dict[str, Any], line: str
) -> None:
    lines = render(record("exp1", partial=True, limits=limits)).splitlines()
    places = [k for k, text in enumerate(lines) if text == line]
    assert len(places) == 2
    assert lines[places[1] + 1].startswith("tactibench 0.1.0|")
    assert partial_line(record("exp1", limits=limits)) == ""


def test_only_runs_of_the_same_question_stand_beside_and_partial_ones_are_marked(
    record: Any, render: Any
) -> None:
    shown = record("exp2")
    newer = record("exp2", name="newer")
    newer.protocol.version += 1
    cut = record("exp2", name="cut", partial=True, limits={"quick": True, "limit": None})
    text = render(shown, 120, [shown, newer, cut, record("exp1", name="else")])
    assert re.findall(r"stored as (\S+)", text) == ["cut;"]
    assert "stored as cut; PARTIAL (quick): not for a board" in text


def test_many_stored_runs_do_not_hide_the_run(record: Any, render: Any) -> None:
    text = render(record("exp2"), 80, [record("exp2", name=f"r{k}") for k in range(9)])
    assert text.count("stored as") == 6
    assert "3 more stored runs of exp2 are not shown" in text


def test_a_protocol_without_a_layout_is_listed_whole(record: Any, render: Any) -> None:
    shown = record("exp3")
    shown.protocol.id = "mine"
    text = render(shown)
    assert text.count("\n") > len(shown.metrics)
    assert "published" not in text


def test_markup_in_names_is_text(record: Any, render: Any) -> None:
    assert "[bold]x[/bold]" in render(record("exp1", signature="[bold]x[/bold]"))


def test_a_run_states_how_its_true_indentation_was_made(record: Any) -> None:
    whole = record("exp1")
    described = {
        "depth_offset_mm": 5.034,
        "pivot_mm": 20.53,
        "pivot_side_mm": -0.375,
        "columns": {"depth": "pose_2", "tilt": "pose_6"},
        "label_fit": {"presses": 1500, "left_out": 12, "misfit": 0.025, "lean_deg": 90.0},
    }
    tested = AdaptedSensor(described=described)
    data = whole.data.model_copy(update={"of_tested_sensor": tested})
    assert labels_line(whole.model_copy(update={"data": data})) == (
        "true indentation: pose_2 +5.034 +20.53 (1 - cos pose_6) -0.38 sin pose_6 mm, fitted to "
        "the pins of 1,500 presses (12 left out, misfit 2.5%)"
    )
    assert labels_line(whole) == ""
