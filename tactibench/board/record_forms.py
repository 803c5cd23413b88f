"""A record by itself: keys and forms that tactibench writes, and keys that agree with each other.

A key that follows from another key of the record must agree with it. A key that is the submitter's
word must have the form in which tactibench writes it, and a value that a run can have. Keys that
tactibench does not write are refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from typing import Any

from pydantic import BaseModel

from tactibench.board.shipped import OURS
from tactibench.errors import UserError
from tactibench.records import CHECKSUM, PARTS, Record, canonical, with_checksum
from tactibench.run import fingerprint_hash, name_stem

SHA256 = re.compile(r"[0-9a-f]{64}")
FORMS: Mapping[str, re.Pattern[str]] = {
    "identity.commit": re.compile(r"[0-9a-f]{40}(\+dirty)?|installed|unknown"),
    "identity.machine": re.compile(r"[0-9a-f]{12}"),
    "identity.code": SHA256,
    "identity.weights": SHA256,
    "identity.weights_hash": SHA256,
    "identity.predictions_hash": SHA256,
    "identity.sensor": SHA256,
}
"""Key -> the form in which tactibench writes it."""
CREATED = re.compile(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00")
VERSION = re.compile(r"[A-Za-z0-9.+!_-]{1,60}|not installed")
"""Form of a version of a distribution. That of tactibench stands in the signature, and so must not
hold the signs that divide it."""
DISTRIBUTION = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")
SHOWN = re.compile(r"[ !-;=?-_a-{}~]{1,160}")
"""Form of a text that pages and terminals show: ASCII, which has no look-alikes and no marks,
without ``<``, ``>``, ``|`` and ```` ` ````."""
LABEL = re.compile(r"[^/\\<>|]{1,80}(/[^/\\<>|]{1,80})?")
"""Form of the last two names of a folder (see ``folder_label``) or the sensor of a recording."""
PRIOR = re.compile(r"[A-Za-z][A-Za-z0-9 .-]{0,59}")
"""Form of the prior knowledge of a model, which stands in the name of a row."""
AHEAD = timedelta(days=1)
"""Longest time that a record may be ahead of this clock: the clock of a submitter may be fast."""
MOST_PARTS = 64
"""Most graphics cards of a machine, kinds of instructions of its processor, packages with a
version, and configurations that were compared; committed records have at most 8."""
MOST_TIMES = 512
"""Most rows of latency; committed records have at most 30."""
LARGEST_SEED = 2**63 - 1
SCENARIOS = ("single", "offline")
WORD = re.compile(r"[A-Za-z][A-Za-z0-9_ -]{0,39}")
SLACK = 1e-6
"""Relative tolerance; sums of another processor differ in the last digits."""
MOST_NOTES = 4_000
"""Most characters of all notes of a training; the longest in committed records have 127."""


def same(stated: Any, derived: Any, slack: float = SLACK) -> bool:
    """Return whether two JSON values are equal, numbers within a relative tolerance.

    True is not equal to 1, but 1 is equal to 1.0.
    """
    if isinstance(stated, bool) or isinstance(derived, bool):
        return stated is derived
    if isinstance(stated, Mapping) and isinstance(derived, Mapping):
        return stated.keys() == derived.keys() and all(
            same(stated[name], derived[name], slack) for name in stated
        )
    if isinstance(stated, list | tuple) and isinstance(derived, list | tuple):
        pairs = zip(stated, derived, strict=False)
        return len(stated) == len(derived) and all(same(*pair, slack) for pair in pairs)
    if isinstance(stated, float) and isinstance(derived, float):
        return abs(stated - derived) <= slack * max(abs(stated), abs(derived))
    return bool(stated == derived)


def refuse_forms(record: Record, values: Mapping[str, Any], where: str) -> None:
    """Raise UserError for a record that holds what tactibench does not write.

    That is an unknown key, a value in an unknown form, or two keys that do not agree.

    Args:
        record: The record as it was read.
        values: JSON object that it was read from.
        where: Name of the record in messages.
    """
    if not same(values, record.json_values()):
        raise UserError(
            f"{where} holds a value of another type than it is read as, such as a number written "
            "as a text; submit the run with `tactibench board submit`."
        )
    for key in _unknown_keys(record):
        raise UserError(
            f"{where} has the key {key!r}, which this tactibench does not write; submit the run "
            "with `tactibench board submit`, or update tactibench."
        )
    _refuse_long(record, where)
    _refuse_forms(record, where)
    for key, stated, derived in _agreements(record):
        if not same(stated, derived):
            raise differs(where, key, stated, derived, "the rest of the record gives")
    for sentence in _impossible(record):
        raise UserError(f"{where}: {sentence}.")


def differs(where: str, key: str, stated: Any, derived: Any, because: str) -> UserError:
    """Return the error for a key that states another value than the derived one.

    Args:
        where: Name of the record in messages.
        key: The key.
        stated: Value of the record.
        derived: Value that it should have.
        because: What gives the derived value, as subject and verb.
    """
    return UserError(f"{where}: {key} is {short(stated)}, but {because} {short(derived)}.")


def short(value: Any) -> str:
    """Return a value as Python writes it, cut off where it is long."""
    text = repr(value)
    return text if len(text) <= 100 else f"{text[:99]}…"


def _unknown_keys(part: BaseModel, place: str = "") -> Iterator[str]:
    """Yield the keys that this version does not know, of all parts to which a version may add keys.

    Free notes and descriptions are dictionaries, whose values are checked elsewhere.
    """
    for key in part.model_extra or {}:
        yield f"{place}{key}"
    for name in type(part).model_fields:
        value = getattr(part, name)
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, BaseModel):
                yield from _unknown_keys(inner, f"{place}{name}.")


def _refuse_long(record: Record, where: str) -> None:
    """Raise UserError for lists that no page has room for, before any of them is compared."""
    facts = record.environment
    lists = (
        ("speed", record.speed, MOST_TIMES),
        ("environment.gpu", facts.gpu, MOST_PARTS),
        ("environment.cpu_flags", facts.cpu_flags, MOST_PARTS),
        ("environment.versions", facts.versions, MOST_PARTS),
        ("identity.versions", record.identity.versions, MOST_PARTS),
    )
    for name, parts, most in lists:
        if len(parts) > most:
            raise UserError(
                f"{where}: {name} has {len(parts):,} entries; a record has at most {most}."
            )


def _refuse_forms(record: Record, where: str) -> None:
    identity = record.identity
    for key, form in FORMS.items():
        stated = getattr(identity, key.partition(".")[2])
        if not isinstance(stated, str) or not form.fullmatch(stated):
            raise UserError(f"{where}: {key} is {short(stated)}, which is no such hash.")
    optional = {name: getattr(identity, name) for name in ("hidden", "tested", "shots")}
    lists = {"data": identity.data or [], "test_frames": identity.test_frames}
    hashes: list[tuple[str, Any]] = [
        *(
            (f"identity.{name}", stated_hash)
            for name, stated_hash in optional.items()
            if stated_hash is not None
        ),
        *(
            (f"identity.{name}", stated_hash)
            for name, stated_hashes in lists.items()
            for stated_hash in stated_hashes
        ),
        *(
            (f"identity.stored.{name}", stated_hash)
            for name, stated_hash in identity.stored.items()
        ),
    ]
    for place, hashed in hashes:
        if not isinstance(hashed, str) or not SHA256.fullmatch(hashed):
            raise UserError(f"{where}: {place} is {short(hashed)}, which is no sha256.")
    texts = [
        (CREATED, "created", record.created),
        *((VERSION, key, version) for key, version in _versions(record)),
        *((SHOWN, key, text) for key, text in _shown(record)),
        *((LABEL, key, text) for key, text in _labels(record)),
    ]
    for form, place, text in texts:
        if not form.fullmatch(text):
            raise UserError(f"{where}: {place} is {short(text)}, which tactibench does not write.")
    if set(identity.stored) != set(PARTS):
        raise UserError(
            f"{where}: identity.stored names {', '.join(sorted(identity.stored)) or 'nothing'}; "
            f"a run stores {', '.join(PARTS)}."
        )


def _versions(record: Record) -> Iterator[tuple[str, str]]:
    """Yield the keys of the versions of distributions, and the versions."""
    for place, versions in (
        ("environment", record.environment.versions),
        ("identity", record.identity.versions),
    ):
        yield from ((f"{place}.versions.{name}", version) for name, version in versions.items())


def _shown(record: Record) -> Iterator[tuple[str, str]]:
    """Yield the keys and the texts that pages show and that nothing else determines."""
    facts = record.environment
    for name in ("cpu", "os", "python", "torch"):
        yield f"environment.{name}", getattr(facts, name) or "none"
    for name in ("gpu", "cpu_flags"):
        yield from ((f"environment.{name}", text) for text in getattr(facts, name))
    yield "training.device", record.training.device or "none"


def _labels(record: Record) -> Iterator[tuple[str, str]]:
    """Yield the keys and the names that somebody gave to a recording and its sensor."""
    recording = record.sensor.recording
    if recording is not None:
        yield "sensor.recording.label", recording.label
        yield "sensor.recording.sensor", recording.sensor or "none"


def _agreements(record: Record) -> Iterator[tuple[str, Any, Any]]:
    """Yield a key, its stated value, and the value that other keys of the record give."""
    identity, limits, environment = record.identity, record.limits, record.environment
    yield "partial", record.partial, limits.quick or limits.limit is not None
    yield "limits.quick", limits.quick, False
    yield "limits.limit", limits.limit, None
    yield "identity.quick", identity.quick, limits.quick
    yield "identity.limit", identity.limit, limits.limit
    yield "identity.presses", identity.presses, limits.presses
    yield "identity.seed", identity.seed, record.seed
    yield "identity.protocol", identity.protocol, f"{record.protocol.label} {record.protocol.hash}"
    yield "identity.encoder", identity.encoder, record.encoder and record.encoder.identity
    if identity.checksum is not None:
        checksum = with_checksum(record.json_values())["identity"][CHECKSUM]
        yield f"identity.{CHECKSUM}", identity.checksum, checksum
    facts = environment.json_values()
    facts = {k: v for k, v in facts.items() if k not in ("fingerprint", "threads", "versions")}
    yield "environment.fingerprint", environment.fingerprint, fingerprint_hash(facts)
    yield "identity.machine", identity.machine, environment.fingerprint
    for name, version in identity.versions.items():
        yield f"environment.versions.{name}", environment.versions.get(name), version
    for name, plugin in identity.plugins.items():
        if isinstance(plugin, Mapping) and plugin.get("distribution") == OURS:
            ours = environment.versions.get(OURS)
            yield f"identity.plugins.{name}.version", plugin.get("version"), ours
    yield "training.presses", record.training.presses, record.data.train
    yield "training.history", record.training.history, []
    yield "efficiency.training_s", record.efficiency.training_s, record.training.seconds
    test = record.test_sensor
    tested = () if test is None else test.options
    stem = name_stem(
        record.protocol.id,
        record.model.name,
        record.regime,
        record.seed,
        presses=limits.presses,
        tested=tested,
    )
    yield "name", record.name[:-9], stem
    yield "sensor.account", record.sensor.scene_counts, {}
    yield "sensor.tested.settings", test and test.settings, None
    yield "identity.tested", identity.tested is None, test is None
    for number, row in enumerate(record.speed):
        total = next(
            (
                other
                for other in record.speed
                if (other.scenario, other.threads, other.batch, other.phase)
                == (row.scenario, row.threads, row.batch, "total")
            ),
            None,
        )
        if total is not None and total.mean_ms > 0:
            yield f"speed.{number}.per_s", row.per_s, 1e3 * row.batch / total.mean_ms


def _impossible(record: Record) -> Iterator[str]:
    """Yield a sentence for every value that no run can have."""
    if not re.fullmatch(r".*-[0-9a-f]{8}", record.name):
        yield f"name is {record.name!r}, which does not end with 8 digits of the identity's hash"
    if not 0 <= record.seed <= LARGEST_SEED:
        yield f"seed is {short(record.seed)}; a seed is 0 or more, below 2^63"
    if record.limits.presses is not None and record.limits.presses < 1:
        yield f"limits.presses is {record.limits.presses}; a model learns from one press or more"
    try:
        created = datetime.fromisoformat(record.created)
        past = created <= datetime.now(UTC) + AHEAD
    except ValueError:
        past = False
    if not past:
        yield f"created is {short(record.created)}, which is no time of the past"
    yield from _impossible_machine(record)
    yield from _impossible_times(record)
    yield from _impossible_training(record)
    for name, plugin in record.identity.plugins.items():
        keys = ("distribution", "version", "code")
        if not isinstance(plugin, Mapping) or set(plugin) != set(keys):
            yield f"identity.plugins.{name} does not hold distribution, version and code"
        elif not all(isinstance(plugin[key], str) for key in keys):
            yield f"identity.plugins.{name} holds something else than texts"
        elif not re.fullmatch(r"[0-9a-f]{16}", plugin["code"]):
            yield f"identity.plugins.{name}.code is no hash"
        elif not VERSION.fullmatch(plugin["version"]):
            yield f"identity.plugins.{name}.version is no version"
        elif not DISTRIBUTION.fullmatch(plugin["distribution"]):
            yield f"identity.plugins.{name}.distribution is no name of a distribution"
        elif (theirs := plugin["distribution"]) != OURS and look_alike(theirs) == look_alike(OURS):
            yield f"identity.plugins.{name}.distribution is {theirs!r}, which looks like {OURS!r}"


def look_alike(name: str) -> str:
    """Return the same text for names that a reader or a file system may mistake for each other."""
    folded = re.sub(r"[-_.]", "", name.casefold()).translate(str.maketrans("01i5", "olls"))
    return folded.replace("rn", "m").replace("vv", "w")


def _impossible_machine(record: Record) -> Iterator[str]:
    facts = record.environment
    for name in ("cores_physical", "cores_logical", "memory_gib"):
        number = getattr(facts, name)
        if number is not None and number < 0:
            yield f"environment.{name} is {number}, less than nothing"
    if facts.threads < 1:
        yield f"environment.threads is {facts.threads}; a run has one or more"


def _impossible_times(record: Record) -> Iterator[str]:
    seen = set()
    for row in record.speed:
        subject = f"speed of phase {short(row.phase)}"
        key = (row.scenario, row.threads, row.batch, row.phase)
        if key in seen:
            yield f"the {subject} is stated twice"
        seen.add(key)
        if row.scenario not in SCENARIOS or not WORD.fullmatch(row.phase):
            yield f"the {subject} is of scenario {short(row.scenario)}; allowed: single, offline"
        if row.threads < 1 or row.batch < 1 or row.mean_ms < 0 or row.per_s <= 0:
            yield f"the {subject} has threads, a batch or times that are not positive"
        if (row.scenario, row.threads, row.batch, "total") not in seen | {
            (r.scenario, r.threads, r.batch, r.phase) for r in record.speed
        }:
            yield f"the {subject} has no row of its total"
        if row.phase == "total" and (row.p50_ms <= 0 or row.mean_ms <= 0):
            yield f"the {subject} takes no time"
        if any(share is not None and not 0 <= share <= 1 for share in (row.stolen, row.foreign)):
            yield f"the {subject} has a share of the processors outside 0..1"
        if any(number is not None and number < 0 for number in (row.cpu_ms, row.load)):
            yield f"the {subject} has a negative processor time or load"
        if row.mean_ms < row.p50_ms / 2 * (1 - SLACK):  # half of the calls take p50 or more
            yield f"the {subject} has a mean below half of its median"
    efficiency = record.efficiency
    for name in ("parameters", "flops_per_frame", "peak_memory_mb"):
        number = getattr(efficiency, name)
        if number is not None and number < 0:
            yield f"efficiency.{name} is {number}, less than nothing"


def _impossible_training(record: Record) -> Iterator[str]:
    training, parameters = record.training, record.model.parameters
    for name in ("seconds", "epochs"):
        number = getattr(training, name)
        if number is not None and number < 0:
            yield f"training.{name} is {number}, less than nothing"
    if (length := len(canonical(training.notes))) > MOST_NOTES:
        yield f"training.notes takes {length:,} characters; at most {MOST_NOTES:,} are kept"
    if "mixing" in training.notes:
        # A board shows the mixing of the notes, where they state it.
        asked, used = parameters.get("mixing"), training.notes["mixing"]
        number = isinstance(asked, int | float) and isinstance(used, int | float)
        if not number or not asked or (asked > 0 and used != asked):  # type: ignore[operator]
            yield f"training.notes.mixing is {short(used)}, but the model has mixing {asked!r}"
    prior = training.notes.get("prior", "none")
    if not isinstance(prior, str) or not PRIOR.fullmatch(prior):
        yield f"training.notes.prior is {short(prior)}; it is a few words"
    if training.prior == "none" and training.notes.get("mixing"):
        yield "training.prior is none, but training.notes.mixing says that frames were mixed"
