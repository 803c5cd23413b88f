"""Families of hard cases: what a protocol may say, and a sentence for everything else."""

from __future__ import annotations

import copy
import tomllib
from typing import Any

import pytest

from tactibench import UserError
from tactibench.protocols import load_protocol, protocol_files

KEYS = load_protocol("stability").spec


@pytest.fixture
def tables() -> dict[str, Any]:
    return tomllib.loads(protocol_files()["stability"].read_text(encoding="utf-8"))


def changed(tables: dict[str, Any], which: str, /, **more: Any) -> dict[str, Any]:
    """The protocol with keys of one family changed; None takes a key away."""
    out = copy.deepcopy(tables)
    (family,) = (one for one in out["families"] if one["name"] == which)
    family.update(more)
    for key in [key for key, value in family.items() if value is None]:
        del family[key]
    return out


def refused(read_tables: Any, tables: dict[str, Any]) -> str:
    with pytest.raises(UserError) as raised:
        read_tables(tables)
    return str(raised.value)


def test_training_is_that_of_the_experiments() -> None:
    for name in ("exp1", "exp2", "exp3"):
        other = load_protocol(name).spec
        assert KEYS.data_seed == other.data_seed
        assert KEYS.workspace == other.workspace
        assert KEYS.grid == other.grid
        assert KEYS.split == other.split
        assert KEYS.regimes == other.regimes
        trained = {"singles", "duals-train", "triples-train"}
        assert {d.name: d for d in KEYS.draws} == {
            d.name: d for d in other.draws if d.name in trained
        }


def test_every_family_is_graded_from_an_easy_case() -> None:
    assert len({axis.family for axis in KEYS.axes}) == len(KEYS.axes) == 26
    for axis in KEYS.axes:
        assert axis.ordered == (axis.harder != "unordered")
        if axis.ordered:
            assert axis.reference in {f"{axis.family}:{axis.easy:g}", "plain:0"}
    faults = [family for family in KEYS.families if family.fault]
    assert all(family.axis(KEYS.family("plain")).reference == "plain:0" for family in faults)


@pytest.mark.parametrize(
    ("name", "more", "said"),
    [
        ("blur", {"press": "depth"}, "needs exactly one of press, fault, parameter"),
        ("blur", {"radius_mm": 3.0}, "'blur' takes no radius_mm"),
        ("blur", {"presses": 9}, "leave sensor and presses out"),
        ("grazing", {"radius_mm": None}, "'grazing' needs radius_mm"),
        ("grazing", {"easy": None}, "it needs an easy value"),
        ("grazing", {"values": [0.1, 0.2]}, "easy and values must be in that order"),
        ("grazing", {"stream": 104}, "two tables take the same stream"),
        ("individual", {"values": [1, 1]}, "holds a value twice"),
    ],
)
def test_a_family_that_cannot_be_is_refused(
    read_tables: Any, tables: dict[str, Any], name: str, more: dict[str, Any], said: str
) -> None:
    assert said in refused(read_tables, changed(tables, name, **more))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"cases": None}, "[cases] and [[families]] belong"),
        ({"test": {"group": "all"}}, "test.group = 'case' belong"),
        ({"cases": {"base": "grazing"}}, "must press scenes with the sensor as it is"),
        ({"cases": {"untouched": []}}, "cases.untouched needs cases.empty"),
        ({"cases": {"untouched": ["dimm"]}}, "named 'dimm'; did you mean 'dim'"),
        ({"cases": {"untouched": ["deep"]}}, "names 'deep', which is no family of a fault"),
    ],
)
def test_tables_that_do_not_fit_are_refused(
    read_tables: Any, tables: dict[str, Any], change: dict[str, Any], said: str
) -> None:
    for key, value in change.items():
        if value is None:
            del tables[key]
        else:
            tables[key].update(value)
    assert said in refused(read_tables, tables)


def test_only_families_are_grouped_by_case(read_tables: Any) -> None:
    exp1 = tomllib.loads(protocol_files()["exp1"].read_text(encoding="utf-8"))
    exp1["test"]["group"] = "case"
    assert "test.group = 'case' belong" in refused(read_tables, exp1)
