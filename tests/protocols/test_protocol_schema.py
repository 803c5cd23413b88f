"""Every wrong protocol file gets one sentence that names the file and the key."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from tactibench import UserError
from tactibench.metrics import check_metrics
from tactibench.protocols import (
    LoadedProtocol,
    Protocol,
    first_mistake,
    load_protocol,
    protocol_files,
    protocol_titles,
)

Read = Callable[[dict[str, Any]], LoadedProtocol]


def places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of all keys."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inside in items:
        if isinstance(value, dict):
            yield (*at, key)
        tables = isinstance(inside, list) and all(isinstance(one, dict) for one in inside)
        if isinstance(inside, dict) or tables:
            yield from places(inside, (*at, key))


def inside(tables: Any, where: tuple[Any, ...]) -> Any:
    for part in where:
        tables = tables[part]
    return tables


def sentence(read: Read, tables: dict[str, Any]) -> str:
    with pytest.raises(UserError) as raised:
        read(tables)
    text = str(raised.value)
    assert "mine.toml" in text
    assert "\n" not in text
    assert text.endswith((".", "?"))
    return text


@pytest.mark.parametrize("name", protocol_files())
def test_shipped_protocols_are_valid_and_named_like_their_files(name: str) -> None:
    protocol = load_protocol(name)
    check_metrics(protocol)
    assert protocol.spec.id == name
    assert protocol_titles()[name] == (protocol.spec.version, protocol.spec.title)


def test_every_table_refuses_a_misspelt_key_with_the_right_one(
    read_tables: Read, exp2: dict[str, Any]
) -> None:
    checked = 0
    for where in list(places(exp2))[::2]:
        if where[0] == "regimes" and len(where) > 1:  # names of regimes are free
            continue
        broken = copy.deepcopy(exp2)
        table = inside(broken, where[:-1])
        table[f"{where[-1]}s"] = table.pop(where[-1])
        text = sentence(read_tables, broken)
        assert f"did you mean {where[-1]!r}?" in text, where
        checked += 1
    assert checked > 20


@pytest.mark.parametrize("wrong", ["x y", 1.5, []])
def test_a_value_of_the_wrong_kind_is_shown(
    read_tables: Read, exp2: dict[str, Any], wrong: Any
) -> None:
    exp2["version"] = wrong
    text = sentence(read_tables, exp2)
    assert "'version'" in text
    assert repr(wrong) in text


def put(tables: dict[str, Any], where: str, value: Any) -> None:
    *path, last = where.split(".")
    table: Any = tables
    for part in path:
        table = table[int(part)] if part.isdigit() else table[part]
    table[last] = value


@pytest.mark.parametrize(
    ("where", "value", "said"),
    [
        ("workspace.depth_min_mm", 6.0, "depth_min_mm must be smaller"),
        ("workspace.half_width_mm", 20.0, "half_width_mm must be smaller"),
        ("draws.1.stream", 1, "same stream"),
        ("draws.1.name", "singles", "'singles' 2 times"),
        ("draws.0.count", 1400, "leaves none to train on"),
        ("draws.0.per_distance", 3, "either count or per_distance"),
        ("draws.0.distances_mm", [7.0], "takes no distances_mm"),
        ("split.draw", "single", "did you mean 'singles'?"),
        ("split.draw", "pairs", "must have a count"),
        ("regimes.multiple", ["singles"], "always in it"),
        ("regimes.multiple", ["pairs"], "both trained on and tested"),
        ("test.catch", "pairs", "single presses"),
        ("test.sets", ["catch", "triples-train"], "both trained on and tested"),
        ("test.sets", ["catch", "singles"], "needs dual presses"),
        ("test.cluster", "frame", "'press'"),
        ("answer", "plate", "no draw presses a plate"),
        ("recorded", {"test_share": 0.2, "validation_share": 0.1}, "exactly one of"),
        ("grid.pitch_mm", float("inf"), "finite"),
        ("schema", 2, "'schema' is 2"),
        ("published.tables", ["tactiverse", "x y"], "'published.tables.2' is 'x y'"),
    ],
)
def test_rules_between_keys(
    read_tables: Read, exp2: dict[str, Any], where: str, value: Any, said: str
) -> None:
    put(exp2, where, value)
    assert said in sentence(read_tables, exp2)


@pytest.mark.parametrize(
    ("where", "value", "said"),
    [
        ("test.apart.0.sets", ["uneven", "singles"], "'singles' of [[test.apart]] is trained on"),
        ("test.apart.0.name", "held-out", "name"),
        ("draws.4.tip_count", 2, "takes no tip_count"),
    ],
)
def test_rules_of_tests_apart(
    read_tables: Read, exp2: dict[str, Any], where: str, value: Any, said: str
) -> None:
    put(exp2, where, value)
    assert said in sentence(read_tables, exp2)


def test_a_metric_of_a_test_apart_that_does_not_exist(
    read_tables: Read, exp2: dict[str, Any]
) -> None:
    exp2["test"]["apart"][1]["metrics"] = ["mist"]
    with pytest.raises(UserError, match=r"metrics of test\.apart 'unseen'.*did you mean 'missed'"):
        check_metrics(read_tables(exp2))


@pytest.mark.parametrize(
    ("where", "value", "said"),
    [
        ("recorded.test_frames_size", [360, 360], "belong together"),
        ("regimes.recorded", ["more"], "empty regimes"),
        ("test.sets", ["others"], "sets = ['recorded']"),
        ("test.group", "distance", "group = 'all'"),
        (
            "draws",
            [{"name": "a", "indenter": "single", "radius_mm": 3.0, "stream": 1, "count": 2}],
            "has no draws",
        ),
        ("recorded.test_frames", "nowhere.txt", "belong together"),
    ],
)
def test_rules_of_recorded_protocols(
    read_tables: Read, surface: dict[str, Any], where: str, value: Any, said: str
) -> None:
    put(surface, where, value)
    assert said in sentence(read_tables, surface)


def test_a_missing_list_of_test_frames(read_tables: Read, surface: dict[str, Any]) -> None:
    surface["recorded"] |= {"test_frames": "nowhere.txt", "test_frames_size": [360, 360]}
    assert "nowhere.txt" in sentence(read_tables, surface)


@pytest.mark.parametrize(
    ("name", "said"),
    [("mae_m", "did you mean 'mae_mm'?"), ("coverage", "answers that are contacts")],
)
def test_metrics_that_do_not_fit(
    read_tables: Read, exp2: dict[str, Any], name: str, said: str
) -> None:
    exp2["metrics"]["names"] = [name]
    protocol = read_tables(exp2)
    with pytest.raises(UserError, match=r"metrics\.names") as raised:
        check_metrics(protocol)
    assert said in str(raised.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (None, "cannot be read"),
        ("folder", "cannot be read"),
        (b"\xff\xfe", "not valid TOML"),
        (b"", "is missing"),
        (b"a = " + b"[" * 100_000, "not valid TOML"),
    ],
    ids=["absent", "folder", "binary", "empty", "deep"],
)
def test_unreadable_files(tmp_path: Path, content: bytes | str | None, said: str) -> None:
    path = tmp_path / "mine.toml"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content:
        path.mkdir()
    with pytest.raises(UserError, match=said):
        load_protocol(str(path))


def test_unknown_names_get_the_close_match() -> None:
    with pytest.raises(UserError, match=r"unknown protocol 'exp_2'; did you mean 'exp2'\?"):
        load_protocol("exp_2")
    with pytest.raises(UserError, match="cannot be read"):
        load_protocol("a\0.toml")


EXP2 = protocol_files()["exp2"].read_text(encoding="utf-8")


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_no_value_gives_anything_but_a_protocol_or_a_sentence(
    data: st.DataObject,
) -> None:
    tables = tomllib.loads(EXP2)
    leaf = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
    value = data.draw(st.recursive(leaf, lambda x: st.lists(x, max_size=3), max_leaves=4))
    where = data.draw(st.sampled_from(list(places(tables))))
    inside(tables, where[:-1])[where[-1]] = value
    try:
        Protocol.model_validate(tables)
    except ValidationError as error:
        text = first_mistake(error, Protocol)
        assert "\n" not in text
        assert text.endswith((".", "?"))
