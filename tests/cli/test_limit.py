"""``tactibench plot limit`` on the sensors that ship."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest


def limits(cli: Any, tmp_path: Path, *options: str) -> dict[str, float]:
    """Metric -> its value in the middle of the workspace."""
    code, _, err = cli("plot", "limit", "--depth", "2", "--json", "limit.json", *options)
    assert (code, err) == (0, "")
    rows = json.loads((tmp_path / "limit.json").read_text(encoding="utf-8"))
    return {row["metric"]: row["value"] for row in rows if row["group"] == "depth 2 mm, middle"}


def test_the_table_the_map_and_the_file(cli: Any, tmp_path: Path) -> None:
    code, out, err = cli(
        "plot limit --range 1.6 --step 1.6 --depth 2 --scene dual --spacing 6.5 --out map.png "
        "--json limit.json"
    )
    assert (code, err) == (0, "")
    assert "simulated sensor tactip-127, dual 6.5 mm apart" in out
    assert "picture: map.png" in out
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((tmp_path / "limit.json").read_text(encoding="utf-8"))
    rows = {(row["metric"], row["group"]): row for row in found}
    middle = rows["bound_separation_mm", "depth 2 mm, middle"]
    assert 5e-4 < middle["value"] < 2e-2  # some micrometres; a score below is the simulator's
    assert f"{1000 * middle['value']:#.3g}" in out
    assert "Below 6 mm the two spheres overlap" in out
    assert f"{rows['limit_mm', 'depth 2 mm, middle']['value']:.2f}" in out


def test_nuisances_and_parameters_change_the_bound(cli: Any, tmp_path: Path) -> None:
    dual = ("--range", "0", "--scene", "dual")
    usual = limits(cli, tmp_path, *dual)
    some = limits(cli, tmp_path, *dual, "--nuisance", "shift, brightness")
    every = limits(cli, tmp_path, *dual, "--nuisance", "all")
    noisy = limits(cli, tmp_path, *dual, "--param", "sensor.read_noise=12")
    for quantity, value in usual.items():
        assert value <= some[quantity] * (1 + 1e-4)
        assert some[quantity] <= every[quantity] * (1 + 1e-4)
        assert noisy[quantity] > 1.2 * value
    assert every["bound_depth_mm"] > usual["bound_depth_mm"] * 1.01
    assert (
        limits(cli, tmp_path, "--range", "0", "--sensor", "tactip-331")["bound_x_mm"]
        != (usual["bound_x_mm"])
    )


def test_presses_outside_are_empty_cells_and_a_sentence(cli: Any) -> None:
    code, out, err = cli("plot limit --range 20 --step 20 --depth 1")
    assert (code, err) == (0, "")
    assert "are refused: a tip touches" in out


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--sensor", "tactip-128"), "did you mean 'tactip-127'?"),
        (("--sensor", "recorded"), "does not know what limits its frames"),
        (("--nuisance", "brigthness"), "did you mean 'brightness'?"),
        (("--param", "model.width=3"), "KIND one of sensor; "),
        (("--param", "width=3"), "KIND one of sensor; "),
        (("--spacing", "7"), "add --scene dual"),
        (("--depth", "1;3"), "no list of numbers such as 1,3,6"),
        (("--depth", "0"), "not above 0"),
        (("--depth", "9"), "tables end"),
        (("--step", "0.05"), "more than 101 presses"),
        (("--step", "5e-324"), "more than 101 presses"),
        (("--range", "-1"), "range -1 mm is not from 0 to 40"),
        (("--range", "inf"), "range inf mm is not from 0 to 40"),
        (("--range", "nan"), "range nan mm is not from 0 to 40"),
        (("--depth", "1,nan"), "depth nan mm is not above 0 and at most 40"),
        (("--scene", "dual", "--spacing", "nan"), "spacing nan mm is not above 0"),
        (("--scene", "dual", "--spacing", "inf"), "spacing inf mm is not above 0"),
        (("--scene", "dual", "--yaw", "inf"), "yaw inf deg is not a finite angle"),
        (("--out", "map.pdf"), "call it map.png"),
    ],
)
def test_a_mistake_gets_one_sentence(refused: Any, options: tuple[str, ...], named: str) -> None:
    assert named in refused("plot", "limit", *options)
