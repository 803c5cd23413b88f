"""Every property of an encoder is held by the good example and catches a broken one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tactibench import Contacts, Grid
from tactibench.testing import examine, properties, run_checks, subject_of
from tactibench.testing.runner import FAILED, SKIPPED

PROPERTIES = {one.name: one for one in properties("encoder")}


def no_tolerance(good: Any) -> Any:
    class Broken(good):
        tolerance = None

    return Broken


def narrow_is_refused_badly(good: Any) -> Any:
    class Broken(good):
        def __init__(
            self, max_depth: float = 6.0, sigma: float = 0.8, *rest: Any, **keys: Any
        ) -> None:
            super().__init__(max_depth, sigma, *rest, **keys)
            self.step = 1 / (sigma - 0.1)

    return Broken


def reading(change: Callable[[Contacts, Any], Contacts], **declared: Any) -> Callable[[Any], Any]:
    """An encoder whose contacts are changed. change: contacts and maps -> contacts."""

    def broken(good: Any) -> Any:
        class Broken(good):
            def decode(self, maps: Any, grid: Any) -> Any:
                return change(super().decode(maps, grid), np.asarray(maps))

        for name, value in declared.items():
            setattr(Broken, name, value)
        return Broken

    return broken


def drawing(change: Callable[[Any, Contacts], Any]) -> Callable[[Any], Any]:
    """An encoder whose maps are changed. change: maps and contacts -> maps."""

    def broken(good: Any) -> Any:
        class Broken(good):
            def encode(self, contacts: Any, grid: Any) -> Any:
                return change(super().encode(contacts, grid), contacts)

        return Broken

    return broken


def to_steps(step: float) -> Callable[[Contacts, Any], Contacts]:
    return lambda c, _: Contacts(np.rint(c.xy / step) * step, c.depth, c.score)


def always_one(contacts: Contacts, _: Any) -> Contacts:
    return contacts if len(contacts) else Contacts.truth([[0, 0]], [1])


def not_at_the_border(c: Contacts, _: Any) -> Contacts:
    inside = (np.abs(c.xy) < 11).all(axis=1)
    return Contacts(c.xy[inside], c.depth[inside], c.score[inside])


def faintest_first(c: Contacts, _: Any) -> Contacts:
    return Contacts(c.xy, c.depth, 1 - c.score)


def second_is_fainter(maps: Any, contacts: Contacts) -> Any:
    return maps * np.float32(0.99) if len(contacts) > 1 and contacts.xy[0, 0] > 0 else maps


def claims_more(good: Any) -> Any:
    class Broken(good):
        def __init__(self, *arguments: Any, **keys: Any) -> None:
            super().__init__(*arguments, **keys)
            self.separation = 1.0

    return Broken


def scribbles(good: Any) -> Any:
    class Broken(good):
        def decode(self, maps: Any, grid: Any) -> Any:
            if isinstance(maps, np.ndarray) and maps.flags.writeable:
                maps[0, 0, 0] += 0.01
            return super().decode(maps, grid)

    return Broken


def batch_differs(good: Any) -> Any:
    class Broken(good):
        def decode_batch(self, maps: Any, grid: Any) -> Any:
            return [
                Contacts(c.xy + 0.01, c.depth, c.score) for c in super().decode_batch(maps, grid)
            ]

    return Broken


def encode_batch_differs(good: Any) -> Any:
    class Broken(good):
        def encode_batch(self, contacts: Any, grid: Any) -> Any:
            return np.zeros((len(contacts), 1, *grid.shape), np.float32)

    return Broken


def float32_only(good: Any) -> Any:
    class Broken(good):
        def decode(self, maps: Any, grid: Any) -> Any:
            if maps.dtype != np.float32:
                raise TypeError(maps.dtype)
            return super().decode(maps, grid)

    return Broken


def reads_anything(good: Any) -> Any:
    class Broken(good):
        def decode(self, maps: Any, grid: Any) -> Any:
            flat = np.nan_to_num(np.asarray(maps, dtype=np.float64), posinf=1, neginf=0)
            return super().decode(np.resize(flat, (1, *grid.shape)), grid)

    return Broken


def clips_depth(good: Any) -> Any:
    class Broken(good):
        def encode(self, contacts: Any, grid: Any) -> Any:
            depth = np.clip(contacts.depth, 0, self.max_depth)
            return super().encode(Contacts.truth(contacts.xy, depth), grid)

    return Broken


def one_grid(good: Any) -> Any:
    class Broken(good):
        def decode(self, maps: Any, grid: Any) -> Any:
            return super().decode(maps, Grid(grid.shape, (-12.6, -12.6), 0.4))

    return Broken


BROKEN = [
    ("target", no_tolerance, {}),
    ("parameters", narrow_is_refused_badly, {}),
    ("empty", reading(always_one), {}),
    ("round_trip", reading(to_steps(0.4)), {}),
    ("round_trip", drawing(lambda maps, _: maps.astype(np.float64)), {}),
    ("round_trip", drawing(lambda maps, _: 2 * maps), {}),
    ("border", reading(not_at_the_border), {}),
    ("permutation", drawing(second_is_fainter), {}),
    ("shift", reading(lambda c, _: Contacts(1.0001 * c.xy, c.depth, c.score)), {}),
    ("refine", reading(to_steps(0.05)), {}),
    ("noise", reading(faintest_first), {}),
    ("close_pair", claims_more, {}),
    ("pure", scribbles, {}),
    ("pure", batch_differs, {}),
    ("pure", encode_batch_differs, {}),
    ("dtype", float32_only, {}),
    ("scores", reading(lambda c, _: Contacts.truth(c.xy, c.depth)), {}),
    ("finite", reads_anything, {}),
    ("shape", reads_anything, {}),
    ("depth_range", clips_depth, {}),
    ("too_many", lambda good: good, {"max_contacts": 1}),
    ("another_grid", one_grid, {}),
    ("several", reading(lambda c, _: c.top(2)), {}),
]


def test_every_property_has_a_broken_example() -> None:
    assert {name for name, _, _ in BROKEN} == set(PROPERTIES)


def test_the_good_one_holds_them_all(host: Any) -> None:
    report = run_checks(PROPERTIES.values(), subject_of("encoder", "good_encoder", host=host()))
    assert [finding.line() for finding in report.findings if finding.outcome == FAILED] == []
    assert [one.checked.name for one in report.findings if one.outcome == SKIPPED] == ["too_many"]


@pytest.mark.parametrize(("name", "broken", "fields"), BROKEN)
def test_a_broken_one_is_caught(
    host: Any, target: Any, name: str, broken: Any, fields: dict[str, Any]
) -> None:
    built = host("encoder", broken(target("encoder")), **fields)
    finding = examine(PROPERTIES[name], subject_of("encoder", "good_encoder", host=built))
    assert finding.outcome == FAILED
    assert finding.message
