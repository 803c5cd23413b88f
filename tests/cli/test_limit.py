"""``tactibench plot limit`` on the sensors that ship."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest


def test_the_table_the_map_and_the_file(cli: Any, tmp_path: Path) -> None:
    code, out, err = cli(
        "plot limit --range 1.6 --step 1.6 --depth 2 --scene dual --spacing 6.5 --out map.png "
        "--json limit.json"
    )
    assert (code, err) == (0, "")
    assert "simulated sensor tactip-127, dual 6.5 mm apart" in out
    for quantity in ("x", "y", "depth", "separation"):
        assert any(
            line.split()[:2][-1:] == [quantity] or quantity in line.split()
            for line in out.splitlines()
        )
    assert "picture: map.png" in out
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads((tmp_path / "limit.json").read_text(encoding="utf-8"))
    rows = {(row["metric"], row["group"]): row for row in found}
    middle = rows["bound_separation_mm", "depth 2 mm, middle"]
    assert middle["unit"] == "mm"
    assert 5e-4 < middle["value"] < 2e-2  # some micrometres; a score below is the simulator's
    assert f"{1000 * middle['value']:#.3g}" in out
    assert "Two tips differ from one from this spacing on, mm" in out
    assert "Below 6 mm the two spheres overlap" in out
    assert f"{rows['limit_mm', 'depth 2 mm, middle']['value']:.2f}" in out


def spacing_limits(cli: Any, tmp_path: Path, *options: str) -> list[float]:
    code, _, err = cli(
        *("plot", "limit", "--scene", "dual", "--radius", "3", "--range", "0"),
        *("--depth", "0.5,1,2", "--json", "two.json", *options),
    )
    assert (code, err) == (0, "")
    found = json.loads((tmp_path / "two.json").read_text(encoding="utf-8"))
    return [
        row["value"]
        for row in found
        if row["metric"] == "limit_mm" and row["group"].endswith("middle")
    ]


def test_two_tips_differ_later_in_noise_and_with_an_unknown_camera(
    cli: Any, tmp_path: Path
) -> None:
    usual = spacing_limits(cli, tmp_path)
    assert len(usual) == 3
    noisy = spacing_limits(cli, tmp_path, "--param", "sensor.read_noise=12")
    unknown = spacing_limits(cli, tmp_path, "--nuisance", "all")
    for known, other, blind in zip(usual, noisy, unknown, strict=True):
        assert other > 1.2 * known
        assert blind >= known * (1 - 1e-4)


def middle(cli: Any, tmp_path: Path, *options: str) -> dict[str, float]:
    code, _, err = cli(
        "plot", "limit", "--range", "0", "--depth", "2", "--json", "one.json", *options
    )
    assert (code, err) == (0, "")
    found = json.loads((tmp_path / "one.json").read_text(encoding="utf-8"))
    bounds = [row for row in found if row["group"] == "depth 2 mm, middle"]
    return {row["metric"].split("_")[1]: row["value"] for row in bounds}


def test_nuisances_and_parameters_change_the_bound(cli: Any, tmp_path: Path) -> None:
    usual = middle(cli, tmp_path)
    assert list(usual) == ["x", "y", "depth"]
    some = middle(cli, tmp_path, "--nuisance", "shift, brightness")
    every = middle(cli, tmp_path, "--nuisance", "all")
    noisy = middle(cli, tmp_path, "--param", "sensor.read_noise=6")
    for quantity, value in usual.items():
        assert value <= some[quantity] * (1 + 1e-9)
        assert some[quantity] <= every[quantity] * (1 + 1e-9)
        assert noisy[quantity] > 2 * value
    assert every["depth"] > usual["depth"] * 1.01
    other = middle(cli, tmp_path, "--sensor", "tactip-331")
    assert other != usual


def test_presses_outside_are_empty_cells_and_a_sentence(cli: Any, tmp_path: Path) -> None:
    code, out, err = cli("plot limit --range 20 --step 20 --depth 1 --out m.png")
    assert (code, err) == (0, "")
    assert "are refused: a tip touches" in out
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--sensor", "tactip-128"), "did you mean 'tactip-127'?"),
        (("--sensor", "recorded"), "does not know what limits its frames"),
        (("--nuisance", "brigthness"), "did you mean 'brightness'?"),
        (("--param", "model.width=3"), "only the sensor has parameters here"),
        (("--spacing", "7"), "add --scene dual"),
        (("--depth", "1;3"), "no list of numbers such as 1,3,6"),
        (("--depth", "0"), "not above 0"),
        (("--depth", "9"), "tables end"),
        (("--step", "0.05"), "at most 101"),
        (("--out", "map.pdf"), "call it map.png"),
    ],
)
def test_a_mistake_gets_one_sentence(refused: Any, options: tuple[str, ...], named: str) -> None:
    assert named in refused("plot", "limit", *options)
