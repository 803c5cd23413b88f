"""Every property of an encoder is held by the good example and catches a broken one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from broken import Break, changing, with_attributes

from tactibench import Contacts, Grid
from tactibench.testing import FAILED, SKIPPED, examine, properties, run_checks, subject_of

PROPERTIES = {one.name: one for one in properties("encoder")}


def narrow_is_refused_badly(self: Any, init: Any, *arguments: Any, **keys: Any) -> None:
    init(*arguments, **keys)
    self.step = 1 / (self.sigma - 0.1)


def reading(change: Callable[[Contacts], Contacts]) -> Break:
    """An encoder whose contacts are changed."""
    return changing("decode", lambda _, decode, maps, grid: change(decode(maps, grid)))


def drawing(change: Callable[[Any, Contacts], Any]) -> Break:
    """An encoder whose maps are changed. change: maps and contacts -> maps."""
    return changing("encode", lambda _, encode, c, grid: change(encode(c, grid), c))


def to_steps(step: float) -> Callable[[Contacts], Contacts]:
    return lambda c: Contacts(np.rint(c.xy / step) * step, c.depth, c.score)


def always_one(contacts: Contacts) -> Contacts:
    return contacts if len(contacts) else Contacts.truth([[0, 0]], [1])


def not_at_the_border(c: Contacts) -> Contacts:
    inside = (np.abs(c.xy) < 11).all(axis=1)
    return Contacts(c.xy[inside], c.depth[inside], c.score[inside])


def faintest_first(c: Contacts) -> Contacts:
    return Contacts(c.xy, c.depth, 1 - c.score)


def second_is_fainter(maps: Any, contacts: Contacts) -> Any:
    return maps * np.float32(0.99) if len(contacts) > 1 and contacts.xy[0, 0] > 0 else maps


def claims_more(self: Any, init: Any, *arguments: Any, **keys: Any) -> None:
    init(*arguments, **keys)
    self.separation = 1.0


def scribbles(_: Any, decode: Any, maps: Any, grid: Any) -> Any:
    if isinstance(maps, np.ndarray) and maps.flags.writeable:
        maps[0, 0, 0] += 0.01
    return decode(maps, grid)


def batch_differs(_: Any, decode_batch: Any, maps: Any, grid: Any) -> Any:
    return [Contacts(c.xy + 0.01, c.depth, c.score) for c in decode_batch(maps, grid)]


def no_maps(_: Any, contacts: Any, grid: Any) -> Any:
    return np.zeros((len(contacts), 1, *grid.shape), np.float32)


def reads_anything(_: Any, decode: Any, maps: Any, grid: Any) -> Any:
    flat = np.nan_to_num(np.asarray(maps, dtype=np.float64), posinf=1, neginf=0)
    return decode(np.resize(flat, (1, *grid.shape)), grid)


def one_grid(_: Any, decode: Any, maps: Any, grid: Any) -> Any:
    return decode(maps, Grid(grid.shape, (-12.6, -12.6), 0.4))


BROKEN = [
    ("target", with_attributes(tolerance=None), {}),
    ("parameters", changing("__init__", narrow_is_refused_badly), {}),
    ("empty", reading(always_one), {}),
    ("round_trip", reading(to_steps(0.4)), {}),
    ("round_trip", drawing(lambda maps, _: maps.astype(np.float64)), {}),
    ("round_trip", drawing(lambda maps, _: 2 * maps), {}),
    ("border", reading(not_at_the_border), {}),
    ("permutation", drawing(second_is_fainter), {}),
    ("noise", reading(faintest_first), {}),
    ("close_pair", changing("__init__", claims_more), {}),
    ("pure", changing("decode", scribbles), {}),
    ("pure", changing("decode_batch", batch_differs), {}),
    ("pure", with_attributes(encode_batch=no_maps), {}),
    ("scores", reading(lambda c: Contacts.truth(c.xy, c.depth)), {}),
    ("refusals", changing("decode", reads_anything), {}),
    ("refusals", lambda good: good, {"max_contacts": 1}),
    ("another_grid", changing("decode", one_grid), {}),
]


def test_every_property_has_a_broken_example() -> None:
    assert {name for name, _, _ in BROKEN} == set(PROPERTIES)


def test_the_good_one_holds_them_all(host: Any) -> None:
    report = run_checks(PROPERTIES.values(), subject_of("encoder", "good_encoder", host=host()))
    assert [finding.line() for finding in report.findings if finding.outcome == FAILED] == []
    assert [one.checked.name for one in report.findings if one.outcome == SKIPPED] == []


@pytest.mark.parametrize(("name", "broken", "fields"), BROKEN)
def test_a_broken_one_is_caught(
    host: Any, target: Any, name: str, broken: Any, fields: dict[str, Any]
) -> None:
    built = host("encoder", broken(target("encoder")), **fields)
    finding = examine(PROPERTIES[name], subject_of("encoder", "good_encoder", host=built))
    assert finding.outcome == FAILED
    assert finding.message
