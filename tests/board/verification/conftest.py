"""Submissions to small protocols on a tiny sensor, made from the truth that is drawn again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from few_presses import few_presses

from tactibench import Contacts, SensorSpec
from tactibench.board import (
    FOLDER,
    Source,
    TestSet,
    answers_file,
    compact,
    make_test_set,
    ranked_errors,
    text_of,
    verification,
)
from tactibench.plugins import Catalogue, Origin
from tactibench.protocols import LoadedProtocol, loader, read_protocol
from tactibench.records import (
    PARTS,
    Efficiency,
    FrameCounts,
    Record,
    arrays_hash,
    make_signature,
    pack_contacts,
    unpack_contacts,
    write_arrays,
)
from tactibench.run import fingerprint_hash, score_arrays

SHA = "ab" * 32


@pytest.fixture
def mini(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], LoadedProtocol]:
    """exp1, exp2 and exp3 with few presses, in place of those that ship."""
    files = few_presses(tmp_path / "protocols", prefix="")
    for module in (verification, loader):
        monkeypatch.setattr(module, "protocol_files", lambda: files)
    return lambda name: read_protocol(files[name])


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Source:
    """A host whose one sensor is tiny."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "run" / "fake")
    specs = {
        "tactip-127": SensorSpec("tactip-127", "tiny_tactile.parts:TinySensor", "tiny"),
        "recorded": SensorSpec(
            "recorded", "tiny_tactile.parts:TinySensor", "tiny", needs_data=True
        ),
    }
    origins = dict.fromkeys(specs, Origin("tiny", "tactibench", "1"))
    none: Any = Catalogue("model", {}, {}, {})
    sensors = Catalogue("sensor", specs, origins, {})
    host: Any = SimpleNamespace(sensors=sensors, models=none, encoders=none)
    return Source(host, tmp_path / "cache")


@pytest.fixture
def submitted(
    mini: Callable[[str], LoadedProtocol], source: Source, tmp_path: Path, fabricate: Any
) -> Callable[..., Path]:
    """Protocol, keywords of ``fabricate`` -> a submission that holds; the path of its record."""

    def made(asked: str = "exp1", *, hidden: Any = None, **more: Any) -> Path:
        protocol = mini(asked)
        record = stated(fabricate(asked, encoder=None, **more), protocol)
        made = make_test_set(record, protocol, source, hidden)
        truth = made.truth
        state(record, made)
        answers = pack_contacts([moved(contacts) for contacts in unpack_contacts(truth)])
        record.metrics = score_arrays(protocol.spec, truth, answers, {})
        return write(tmp_path, record, answers, ranked_errors(protocol.spec, truth, answers))

    return made


def stated(record: Record, protocol: LoadedProtocol) -> Record:
    """The record as one of that protocol, of a machine and of plugins."""
    record.protocol.hash = protocol.hash
    record.model.parameters = {}
    record.sensor.parameters = {}
    environment, identity = record.environment, record.identity
    environment.versions = {"tactibench": "1"}
    facts = {"cpu": environment.cpu, "cores_logical": environment.cores_logical}
    environment.fingerprint = fingerprint_hash(facts)
    identity.machine = environment.fingerprint
    identity.protocol = f"{protocol.label} {protocol.hash}"
    identity.seed, identity.quick = record.seed, False
    for key in ("weights", "code", "sensor", "weights_hash"):
        setattr(identity, key, SHA)
    plugin = {"distribution": "tactibench", "version": "1", "code": SHA[:16]}
    identity.plugins = {"tiny": plugin, "theirs": {**plugin, "distribution": "theirs"}}
    record.efficiency = Efficiency(training_s=record.training.seconds)
    return record


def state(record: Record, made: TestSet) -> None:
    """Let the record say what its sensors and its protocol determine, and sign it."""
    counts = {**record.data.json_values(), **made.derived.data}
    record.data = FrameCounts.model_validate(counts)
    record.training.presses = record.data.train
    record.identity.data = record.identity.test_frames = [SHA] * made.derived.sets
    record.signature = make_signature(record)


def moved(contacts: Contacts) -> Contacts:
    """An answer that is 0.1 mm off along x."""
    return Contacts(contacts.xy + np.array([0.1, 0.0]), contacts.depth, np.full(len(contacts), 0.9))


def write(folder: Path, record: Record, answers: Any, ranked: Any) -> Path:
    hashed = arrays_hash(answers)
    record.identity.predictions_hash = hashed
    record.identity.stored = {**dict.fromkeys(PARTS, SHA), "predictions": hashed}
    path = folder / FOLDER / record.protocol.id / f"{record.name}.json"
    write_arrays(answers_file(path), {**answers, **ranked})
    path.write_text(text_of(compact(record)), encoding="utf-8")
    return path
