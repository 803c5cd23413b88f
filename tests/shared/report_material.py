"""Stored runs and records for the tests of the HTML report; hostile ones, too."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from changed_record import changed_record
from stored_answers import answered_parts, store_run

from tactibench.contacts import Contacts
from tactibench.records import Record, StoredRun, pack_contacts

DISTANCES = ("6.5", "7.0", "8.0", "9.0", "10.0", "12.0")
SCRIPT = "</script><script>window.broken=1</script>"
IMAGE = "<img src=x onerror=window.broken=1>"
LINK = "[x](javascript:window.broken=1) <a href='javascript:window.broken=1'>x</a>"
SEPARATOR = "\u2028window.broken=1//$x$ %{x} &lt;b&gt; {{7*7}}"
HOSTILE = (SCRIPT, IMAGE, LINK, SEPARATOR)


def exp2_metrics(share: float) -> tuple[tuple[str, str, float | None], ...]:
    """Rows of a model that resolves more pairs the further they are apart, ``share`` the least."""
    shares = np.linspace(share, 0.98, len(DISTANCES))
    rows: list[tuple[str, str, float | None]] = []
    for distance, value in zip(DISTANCES, shares.tolist(), strict=True):
        rows += [
            ("resolved", distance, value),
            ("distance_mae_mm", distance, 1.1 - value),
            ("distance_penalised_mm", distance, 5 * (1.05 - value)),
        ]
    return (
        *rows,
        ("resolved", "all", 0.7),
        ("distance_mae_mm", "all", 0.4),
        ("catch_resolved", "all", 0.01),
        ("threshold_mm", "all", 8.4),
    )


def contact_parts(frames: int = 24, seed: int = 0) -> dict[str, dict[str, Any]]:
    """PARTS of a run of exp1 with frames and heatmaps, one frame of which is not answered."""
    parts = answered_parts(frames=frames, seed=seed, missing=(3,))
    rng = np.random.default_rng(seed)
    heat = np.zeros((frames, 64, 64), dtype=np.float16)
    heat[:, 20:30, 30:40] = 0.5
    parts["maps"] = {"maps": heat, "surface": 5 * heat}
    parts["examples"] = {
        "index": np.arange(frames),
        "images": rng.integers(0, 255, (frames, 32, 32), dtype=np.uint8),
    }
    return parts


def pair_parts(seed: int = 0) -> dict[str, dict[str, Any]]:
    """PARTS of a run of exp2: five pairs a distance; in every other one a tip is missed."""
    rng = np.random.default_rng(seed)
    truth, found, groups = [], [], []
    for distance in DISTANCES:
        for k in range(5):
            middle = rng.uniform(-1, 1, 2)
            half = np.array([float(distance) / 2, 0.0])
            tips = np.array([middle - half, middle + half])
            truth.append(Contacts.truth(tips, [2.0, 2.0]))
            kept = tips[: 1 + k % 2] + 0.1
            found.append(Contacts.truth(kept, np.full(len(kept), 2.1)))
            groups.append(distance)
    parts = answered_parts()
    parts["truth"] = {
        **pack_contacts(truth),
        "press": np.array([f"pairs-{k}" for k in range(len(truth))]),
        "group": np.array(groups),
    }
    parts["predictions"] = pack_contacts(found)
    return parts


def store_of(folder: Path, fabricate: Callable[..., Record]) -> list[StoredRun]:
    """A store with three rows of exp1, one of two seeds, and two of exp2."""
    runs = []

    def stored(parts: dict[str, dict[str, Any]], **more: Any) -> None:
        runs.append(store_run(folder, fabricate(**more), parts))

    for seed in (0, 1):
        stored(contact_parts(seed=7), error=0.05 + 0.01 * seed, seed=seed, p90_ms=6 + seed)
    stored(contact_parts(seed=7), model="cnn", encoder=None, error=0.09, p90_ms=3.0)
    stored(contact_parts(seed=7), model="mean", encoder=None, error=2.5, p90_ms=1.0)
    for regime, share in (("single", 0.1), ("multiple", 0.4)):
        stored(
            pair_parts(),
            protocol="exp2",
            regime=regime,
            error=1 / share,
            p90_ms=10 * share,
            metrics=exp2_metrics(share),
        )
    return runs


def hostile_record(fabricate: Callable[..., Record], text: str, **more: Any) -> Any:
    """A valid record whose every name, version and setting is ``text``."""
    parts = f"model:{text}({text}={text})|regime:single|encoder:{text}|sensor:{text}"
    return changed_record(
        fabricate(**more),
        {
            "model": {"name": text, "parameters": {text: text}, "settings": [text]},
            "encoder": {"name": text, "parameters": {}, "settings": []},
            "sensor.name": text,
            "signature": f"protocol:x|{parts}|seed:0",
            "regime": text,
            "environment.cpu": text,
            "environment.os": text,
            "environment.gpu": [text],
            "environment.versions": {text: text},
            "environment.fingerprint": text,
            "identity.commit": text,
            "identity.plugins": {text: {"distribution": text, "version": text}},
            "timed.configuration": text,
            "training.device": text,
        },
    )
