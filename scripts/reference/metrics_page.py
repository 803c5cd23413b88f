"""docs/reference/metrics.md: every metric, its formula, unit, direction and source."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from reference.keys import Keys
from reference.text import anchor, code, grid, plain
from tactibench.metrics import FAMILIES, PUBLISHED_NAMES, MetricSpec, all_metrics
from tactibench.protocols import protocol_files, read_protocol
from tactibench.run import LIMIT, THRESHOLD

BETTER = {
    "lower": "lower is better",
    "higher": "higher is better",
    "none": "no direction is better",
}
IN_RECORDS, OWN = "In records of shipped protocols", "For a protocol of your own"


def lines(root: Path) -> list[str]:
    """Return the lines of the page.

    Raises:
        UserError: keys.toml has no source for a metric, or a source for a metric that is gone.
    """
    keys = Keys.read()
    keys.agree("sources", FAMILIES)
    asked = shipped()
    groups = {name: _groups(root, name) for name in asked}
    where = {name: [p for p, names in asked.items() if name in names] for name in FAMILIES}
    page = ["# Metrics", "", *keys.words["pages"]["metrics"].strip().splitlines(), ""]
    for title, used in ((IN_RECORDS, True), (OWN, False)):
        specs = [spec for spec in all_metrics().values() if bool(where[spec.name]) is used]
        page += [f"## {title}", ""] if specs else []
        page += _table(specs)
        for spec in specs:
            page += _metric(spec, _asked(spec.name, where[spec.name], groups), keys)
    return page


def shipped() -> dict[str, tuple[str, ...]]:
    """Return protocol -> names of the metrics that a record of it can hold.

    Records of a protocol of plates with published tables also hold the differences from published
    predictions. Records of a protocol with a threshold also hold the limit.
    """
    metrics = {}
    for name, path in sorted(protocol_files().items()):
        spec = read_protocol(path).spec
        more = PUBLISHED_NAMES if spec.answer == "plate" and spec.published.tables else ()
        limit = (LIMIT,) if THRESHOLD in spec.metrics.names else ()
        metrics[name] = (*spec.metrics.names, *more, *limit)
    return metrics


def _groups(root: Path, protocol: str) -> Mapping[str, list[str]]:
    """Return metric -> its groups, from the protocol's committed record that has the most rows."""
    files = sorted((root / "leaderboards" / "submissions" / protocol).glob("*.json"))
    records = [json.loads(path.read_text(encoding="utf-8"))["metrics"] for path in files]
    rows: list[dict[str, Any]] = max(records, key=len, default=[])
    groups: dict[str, list[str]] = {}
    for row in rows:
        groups.setdefault(row["metric"], []).append(row["group"])
    return groups


def _table(specs: Iterable[MetricSpec]) -> list[str]:
    rows = [
        [f"[`{spec.name}`](#{anchor(spec.name)})", spec.unit or "1", spec.better] for spec in specs
    ]
    return grid(["metric", "unit", "better"], rows) if rows else []


def _asked(name: str, protocols: list[str], groups: Mapping[str, Mapping[str, list[str]]]) -> str:
    texts = []
    for protocol in protocols:
        of = groups[protocol].get(name, [])
        shown = of if len(of) <= 4 else [of[0], "...", *of[-2:]]
        texts.append(f"`{protocol}`{f' ({chr(44).join(shown)})' if of else ''}".replace(",", ", "))
    return ", ".join(texts)


def _metric(spec: MetricSpec, asked: str, keys: Keys) -> list[str]:
    kinds = [
        word
        for word, possible in (("contacts", spec.contacts), ("plate poses", spec.plates))
        if possible
    ]
    mean = (spec.sample or spec.plate_sample) and not spec.root
    family = f"tactibench/metrics/{FAMILIES[spec.name]}.py"
    facts = [
        f"{spec.unit or 'no unit'}, {BETTER[spec.better]}; of {' or '.join(kinds)}",
        *([f"asked by {asked}"] if asked else []),
        f"compared press by press: {'yes' if mean else 'no, it is no mean over presses'}",
        f"source: {plain(keys.words['sources'][spec.name])}; {code(family)}",
    ]
    formula = plain(spec.formula)
    return [f"### {spec.name}", "", formula, "", *(f"* {fact}" for fact in facts), ""]
