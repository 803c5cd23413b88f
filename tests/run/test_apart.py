"""Tests that are scored apart: held-out geometries and other sensors of the make."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tactibench.metrics.detection import gospa
from tactibench.protocols import load_protocol
from tactibench.records import StoredRun, unpack_contacts
from tactibench.run import RunPlan, rescore

MAIN, BETWEEN, UNEVEN, UNSEEN = 2 * 12 + 4, 11, 8, 2 * 12
"""Test frames of a run: pairs with catch trials, and those that are scored apart."""


@pytest.fixture
def exp2(mini: Callable[[str], str]) -> Path:
    """The protocol with few metrics: intervals take most of the time."""
    path = Path(mini("exp2"))
    text = re.sub(
        r"^(names|metrics) = \[.*?\]",
        r'\1 = ["gospa1_mm", "missed"]',
        path.read_text(),
        flags=re.M | re.S,
    )
    path.write_text(text)
    return path


def without_apart(protocol: Path) -> Path:
    """Write the same protocol without the tests that are scored apart."""
    text = protocol.read_text(encoding="utf-8").replace("few-exp2", "few-plain")
    text = re.sub(r"\[\[test\.apart\]\].*?(?=\n\[)", "", text, flags=re.DOTALL)
    path = protocol.with_name("few-plain.toml")
    path.write_text(text, encoding="utf-8")
    return path


def test_tests_apart_change_nothing_of_the_main_one(
    run: Callable[..., StoredRun], exp2: Path
) -> None:
    apart = run(str(exp2), sensor="several").record
    plain = run(str(without_apart(exp2)), sensor="several").record
    assert apart.identity.weights == plain.identity.weights
    main = [m for m in apart.metrics if m.group.partition(":")[0] not in ("heldout", "unseen")]
    assert [m.json_values() for m in main] == [m.json_values() for m in plain.metrics]
    assert plain.data.test == MAIN
    assert apart.data.test == MAIN + BETWEEN + UNEVEN + UNSEEN


def test_their_frames_come_last_and_only_they_are_in_their_groups(
    run: Callable[..., StoredRun], exp2: Path
) -> None:
    done = run(str(exp2), sensor="several")
    truth, predicted = done.arrays("truth"), done.arrays("predictions")
    groups = truth["group"].tolist()
    assert groups[:MAIN] == [g for g in groups if ":" not in g]
    parts = [("heldout:between", BETWEEN), ("heldout:uneven", UNEVEN)]
    assert groups[MAIN : MAIN + BETWEEN + UNEVEN] == [g for g, n in parts for _ in range(n)]
    pairs = list(zip(unpack_contacts(truth), unpack_contacts(predicted), strict=True))
    values = np.array([gospa(true.xy, seen.xy, 3.0, 1) for true, seen in pairs])
    units = {"heldout": BETWEEN + UNEVEN, "unseen": len(set(groups[-UNSEEN:]))}  # presses, sensors
    for whole, count in (("heldout", BETWEEN + UNEVEN), ("unseen", UNSEEN)):
        inside = np.array([group.startswith(f"{whole}:") for group in groups])
        row = done.record.metric("gospa1_mm", whole)
        assert row is not None
        assert row.n == count == inside.sum()
        assert row.clusters == units[whole]
        assert row.value == pytest.approx(values[inside].mean(), abs=1e-12)
    for group, _ in parts:
        row = done.record.metric("gospa1_mm", group)
        assert row is not None
        assert row.value == pytest.approx(values[np.array(groups) == group].mean(), abs=1e-12)
    assert rescore(done, load_protocol(str(exp2))).metrics == done.record.metrics


def test_every_instance_presses_its_share(planned: Callable[..., RunPlan], exp2: Path) -> None:
    plan = planned(str(exp2), sensor="several")
    unseen = [one for one in plan.frames.test if one.groups[0].startswith("unseen:")]
    assert [set(one.groups) for one in unseen] == [{f"unseen:instance-{k}"} for k in range(1, 9)]
    assert all(len(one.scenes) == 3 for one in unseen)
    # One grey level more an instance is 1/18 mm in x, y and depth of every tip, but for rounding.
    for instance, one in enumerate(unseen, 1):
        for frame in one.open(lambda _: None).frames:
            values = frame.image[:2, :3].astype(float) - 128
            pose = np.sort(values[:, 2])[-1]
            assert abs(pose - instance - 18 * frame.pose.depth) <= 1.0


def test_a_sensor_without_instances_leaves_them_out(
    planned: Callable[..., RunPlan], exp2: Path
) -> None:
    groups = {g.partition(":")[0] for one in planned(str(exp2)).frames.test for g in one.groups}
    assert {"heldout"} == groups & {"heldout", "unseen"}
