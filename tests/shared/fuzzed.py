"""What reads files of strangers, with valid inputs to begin from.

A target takes bytes. It may succeed or raise what becomes a sentence for the user, nothing else.
"""

from __future__ import annotations

import io
import random
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import mutated as m
import numpy as np

from tactibench import UserError
from tactibench.training import DamagedFileError

ROOT = Path(__file__).parents[2]
SENTENCES = (
    UserError,
    click.ClickException,
    click.exceptions.Exit,
    click.exceptions.Abort,
    DamagedFileError,
)
"""DamagedFileError is turned into one by all that read containers."""


@dataclass(frozen=True)
class Target:
    """read: bytes, a scratch folder. seeds: made in the folder. ways: to spoil them."""

    read: Callable[[bytes, Path], Any]
    seeds: Callable[[Path], list[bytes]]
    ways: tuple[m.Mutation, ...] = field(default=(m.bytes_wrong, m.tokens_wrong))


def _in(folder: Path, name: str, data: bytes) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def _files(pattern: str) -> Callable[[Path], list[bytes]]:
    return lambda _: [path.read_bytes() for path in sorted(ROOT.glob(pattern))]


def _protocol(data: bytes, folder: Path) -> None:
    from tactibench.metrics import check_metrics
    from tactibench.protocols import read_protocol

    check_metrics(read_protocol(_in(folder, "p.toml", data)))


def _sweep(data: bytes, folder: Path) -> None:
    from tactibench.sweep import read_sweep

    read_sweep(_in(folder, "s.toml", data))


def _settings(data: bytes, folder: Path) -> None:
    from tactibench_tactip import read_settings

    read_settings(_in(folder, "hw.toml", data))


def _settings_seeds(_: Path) -> list[bytes]:
    from fake_station import EXAMPLE, STAGE

    return [EXAMPLE.encode(), STAGE.encode()]


def _record(data: bytes, folder: Path) -> None:
    from tactibench.board import (
        compact,
        read_submission,
        refuse_differences,
        refuse_names,
        slot,
    )
    from tactibench.records import make_signature, text_of

    name = re.search(rb'"name": "([A-Za-z0-9][A-Za-z0-9_-]*)"', data)
    place = folder / "exp2"
    place.mkdir(exist_ok=True)
    path = _in(place, f"{name[1].decode() if name else 'r'}.json", data)
    record = read_submission(path)
    refuse_names(record, str(path))
    slot(record)
    text_of(compact(record))
    refuse_differences(record.metrics, record.metrics, str(path))
    make_signature(record)


def _records(_: Path) -> list[bytes]:
    found = sorted(ROOT.glob("leaderboards/submissions/exp2/*.json"))
    return [path.read_bytes() for path in found[:: max(1, len(found) // 6)]]


def _answers(data: bytes, folder: Path) -> None:
    from tactibench.board import check_answers, read_answers_file, read_press_errors, split_ranked
    from tactibench.records import arrays_hash, unpack_contacts

    path = _in(folder, "a.npz", data)
    answers, _ = split_ranked(read_answers_file(path))
    arrays_hash(answers)
    read_press_errors(path)
    check_answers(answers, "contacts", 6, str(path))
    unpack_contacts(answers)


def _answers_seeds(_: Path) -> list[bytes]:
    from stored_answers import answered_parts

    good = answered_parts()["predictions"]
    ranked = {"ranked.press": np.array(["a", "b"]), "ranked.error": np.ones(2)}
    made = []
    for arrays in ({}, good, {**good, **ranked}, {**good, "count": np.full(6, 2**62)}):
        stream = io.BytesIO()
        np.savez(stream, **arrays)
        made.append(stream.getvalue())
    return made


def _table(data: bytes, folder: Path) -> None:
    from tactibench.datasets import frame_names, read_table

    table = read_table(folder / "targets.csv", data)
    for column in table.columns:
        table.numeric_share(column)
        for use in (table.numbers, lambda name: frame_names(table.path, table.cells[name])):
            try:
                use(column)
            except UserError:
                continue


def _tables(_: Path) -> list[bytes]:
    comma = "image_name,pose_1,pose_2,pose_6\n" + "".join(
        f"frame_{k}.png,{k}.5,-1e-3,{k}\n" for k in range(5)
    )
    return [
        comma.encode(),
        comma.replace(",", ";").replace(".5", ",5").encode(),
        b"\xef\xbb\xbf" + comma.encode(),
    ]


def _png(data: bytes, _: Path) -> None:
    from tactibench.png import check_png, decode_png

    kind = check_png("it", data)
    decode_png("it", data, kind)


def _pngs(_: Path) -> list[bytes]:
    from tactibench.png import encode_png

    rng = np.random.default_rng(0)
    shapes = ((6, 8), (6, 8, 3), (1, 1))
    return [encode_png(rng.integers(0, 256, shape, dtype=np.uint8)) for shape in shapes]


def _weights(data: bytes, folder: Path) -> None:
    from tactibench.training import load_weights, read_container

    path = _in(folder, "weights.safetensors", data)
    try:
        load_weights(folder, model="m", architecture={"width": 8})
    except UserError:
        read_container(path)


def _weights_seeds(folder: Path) -> list[bytes]:
    import torch

    from tactibench.training import save_weights

    tensors = {"a": torch.arange(6.0).reshape(2, 3), "b": torch.ones(1, dtype=torch.bfloat16)}
    save_weights(folder, tensors, model="m", architecture={"width": 8}, extra={"k": [1]})
    return [(folder / "weights.safetensors").read_bytes()]


JSON, TEXT = (
    (m.json_wrong, m.json_wrong, m.tokens_wrong, m.bytes_wrong),
    (m.tokens_wrong, m.bytes_wrong),
)
TARGETS = {
    "protocol": Target(_protocol, _files("protocols/*.toml"), TEXT),
    "sweep": Target(_sweep, _files("docs/examples/*.toml"), TEXT),
    "hardware": Target(_settings, _settings_seeds, TEXT),
    "record": Target(_record, _records, JSON),
    "answers": Target(_answers, _answers_seeds, (m.arrays_wrong, m.bytes_wrong)),
    "table": Target(_table, _tables, TEXT),
    "png": Target(_png, _pngs, (m.png_wrong, m.png_wrong, m.bytes_wrong)),
    "weights": Target(_weights, _weights_seeds, (m.safetensors_wrong, m.bytes_wrong)),
}


def attempt(target: Target, data: bytes, folder: Path) -> bool:
    """Whether the input was accepted. Any exception but a sentence passes through."""
    try:
        target.read(data, folder)
    except SENTENCES:
        return False
    return True


def inputs(target: Target, folder: Path, seed: int, count: int) -> Any:
    """So many spoilt inputs, the same for the same seed."""
    seeds, rng = target.seeds(folder), random.Random(seed)  # noqa: S311 - nothing secret
    for _ in range(count):
        yield m.mutated(rng, seeds, target.ways)
