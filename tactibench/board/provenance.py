"""The provenance that a record states, compared with what can be derived of it.

A record says more than its answers prove: what was tested, what trained, what was counted, where it
ran. Whatever the protocol, the options and the sensors determine is derived again and compared;
what follows from another key of the record must agree with it; and the rest, which is the
submitter's word, must at least have the form in which tactibench writes it. Keys that tactibench
does not write are refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from pydantic import BaseModel

from tactibench.errors import UserError
from tactibench.plugins.host import PluginHost
from tactibench.plugins.specs import EncoderSpec, ModelSpec, Parameter, SensorSpec
from tactibench.protocols.loader import LoadedProtocol
from tactibench.records.identity import canonical
from tactibench.records.record import Component, Record
from tactibench.records.store import CHECKSUM, PARTS, with_checksum
from tactibench.run.machine import fingerprint_hash
from tactibench.run.plan import name_stem
from tactibench.run.request import DATA

OURS = "tactibench"
"""The distribution whose plugins are trusted."""

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
LARGEST_SEED = 2**63 - 1
SCENARIOS = ("single", "offline")
TEXT = re.compile(r"(?!.*\.\.)[A-Za-z0-9_. -]{0,80}")
"""A text that a parameter without choices may have: a name, which is no path."""
WORD = re.compile(r"[A-Za-z][A-Za-z0-9_ -]{0,39}")
LABEL = re.compile(r"[^/\\<>|]{1,80}(/[^/\\<>|]{1,80})?")
"""The last two names of a folder, see ``folder_label``."""
SLACK = 1e-6
"""Relative; sums of another processor differ in the last digits."""
FIT_SLACK = 1e-3
"""Relative, of numbers that were fitted to the pins of a recording."""
MOST_NOTES = 64
"""Notes of a training; the longest of those here has six."""


@dataclass(frozen=True)
class Derived:
    """All that a protocol, the options and the sensors of a record determine, as a record says it.

    Attributes:
        sensor: keys of ``sensor`` but its parameters. "tested" is there, where another sensor was
            tested.
        tested_values: today's parameters of the tested sensor; None where it is the training one.
        data: keys of ``data``.
        sets: sets of test frames.
        hidden: the hash of the hidden seed.
        released: published predictions that the run may have been compared with.
        trained: whether the training frames are known here.
        shots: whether labelled frames were shown.
    """

    sensor: Mapping[str, Any]
    tested_values: Mapping[str, Any] | None
    data: Mapping[str, Any]
    sets: int
    hidden: str | None = None
    released: tuple[Mapping[str, Any], ...] = ()
    trained: bool = True
    shots: bool = False


def same(stated: Any, derived: Any, slack: float = SLACK) -> bool:
    """Return whether two JSON values are equal, numbers but for a relative slack.

    True is no 1, and 1 is 1.0.
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
    """Raise UserError for a record that says what tactibench does not write.

    That is a key or a form of its own, or two keys that do not agree.

    Args:
        record: as it was read.
        values: the JSON object that it was read from.
        where: names the record in messages.
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
    _refuse_forms(record, where)
    for key, stated, derived in _agreements(record):
        if not same(stated, derived):
            raise _differs(where, key, stated, derived, "the rest of the record gives")
    for sentence in _impossible(record):
        raise UserError(f"{where}: {sentence}.")


def _differs(where: str, key: str, stated: Any, derived: Any, because: str) -> UserError:
    return UserError(f"{where}: {key} is {_short(stated)}, but {because} {_short(derived)}.")


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 100 else f"{text[:99]}…"


def _unknown_keys(part: BaseModel, place: str = "") -> Iterator[str]:
    """Yield the keys of all parts that a version may add keys to, and that this one does not know.

    Free notes and descriptions are dictionaries, whose values are looked at elsewhere.
    """
    for key in part.model_extra or {}:
        yield f"{place}{key}"
    for name in type(part).model_fields:
        value = getattr(part, name)
        for inner in value if isinstance(value, list) else [value]:
            if isinstance(inner, BaseModel):
                yield from _unknown_keys(inner, f"{place}{name}.")


def _refuse_forms(record: Record, where: str) -> None:
    identity = record.identity
    for key, form in FORMS.items():
        stated = getattr(identity, key.partition(".")[2])
        if not isinstance(stated, str) or not form.fullmatch(stated):
            raise UserError(f"{where}: {key} is {_short(stated)}, which is no such hash.")
    optional = {"tested": identity.tested, "shots": identity.shots}
    lists = {"data": identity.data or [], "test_frames": identity.test_frames}
    hashes: list[tuple[str, Any]] = [
        *((f"identity.{name}", one) for name, one in optional.items() if one is not None),
        *((f"identity.{name}", one) for name, several in lists.items() for one in several),
        *((f"identity.stored.{name}", one) for name, one in identity.stored.items()),
    ]
    for place, hashed in hashes:
        if not isinstance(hashed, str) or not SHA256.fullmatch(hashed):
            raise UserError(f"{where}: {place} is {_short(hashed)}, which is no sha256.")
    if set(identity.stored) != set(PARTS):
        raise UserError(
            f"{where}: identity.stored names {', '.join(sorted(identity.stored)) or 'nothing'}; "
            f"a run stores {', '.join(PARTS)}."
        )


def _agreements(record: Record) -> Iterator[tuple[str, Any, Any]]:
    """Yield key, stated value, and the value that other keys of the record give."""
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
    """Yield sentences about values that no run has."""
    if not re.fullmatch(r".*-[0-9a-f]{8}", record.name):
        yield f"name is {record.name!r}, which does not end with 8 digits of the identity's hash"
    if not 0 <= record.seed <= LARGEST_SEED:
        yield f"seed is {_short(record.seed)}; a seed is 0 or more, below 2^63"
    if record.limits.presses is not None and record.limits.presses < 1:
        yield f"limits.presses is {record.limits.presses}; a model learns from one press or more"
    try:
        created = datetime.fromisoformat(record.created)
        plausible = created.tzinfo is not None and 2000 <= created.year < 2100
    except ValueError:
        plausible = False
    if not plausible:
        yield f"created is {_short(record.created)}; it is a time of this century with its zone"
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


def _impossible_times(record: Record) -> Iterator[str]:
    seen = set()
    for row in record.speed:
        what = f"speed of phase {_short(row.phase)}"
        key = (row.scenario, row.threads, row.batch, row.phase)
        if key in seen:
            yield f"the {what} is stated twice"
        seen.add(key)
        if row.scenario not in SCENARIOS or not WORD.fullmatch(row.phase):
            yield f"the {what} is of scenario {_short(row.scenario)}; allowed: single, offline"
        if row.threads < 1 or row.batch < 1 or row.mean_ms < 0 or row.per_s <= 0:
            yield f"the {what} has threads, a batch or times that are not positive"
        if (row.scenario, row.threads, row.batch, "total") not in seen | {
            (r.scenario, r.threads, r.batch, r.phase) for r in record.speed
        }:
            yield f"the {what} has no row of its total"
        if row.phase == "total" and (row.p50_ms <= 0 or row.mean_ms <= 0):
            yield f"the {what} takes no time"
        if row.mean_ms < row.p50_ms / 2 * (1 - SLACK):  # half of the calls take p50 or more
            yield f"the {what} has a mean below half of its median"
    if record.environment.threads < 1:
        yield f"environment.threads is {record.environment.threads}; a run has one or more"
    for timed in (record.timed, *record.timed.raced):
        numbers = (timed.p50_ms, timed.difference_mm, timed.frames, timed.frames_with_another_count)
        if timed.frames_with_another_count > timed.frames or timed.frames > record.data.test:
            yield "a configuration in 'timed' was compared on more frames than were tested"
        if any(number is not None and number < 0 for number in numbers):
            yield "a configuration in 'timed' has a negative time, difference or number of frames"
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
    if len(training.notes) > MOST_NOTES:
        yield f"training.notes has {len(training.notes):,} notes; at most {MOST_NOTES} are kept"
    if "mixing" in training.notes:
        # What a board shows as mixing comes from the notes, where they have it.
        asked, used = parameters.get("mixing"), training.notes["mixing"]
        number = isinstance(asked, int | float) and isinstance(used, int | float)
        if not number or not asked or (asked > 0 and used != asked):  # type: ignore[operator]
            yield f"training.notes.mixing is {_short(used)}, but the model has mixing {asked!r}"
    if not isinstance(training.notes.get("prior", ""), str):
        yield "training.notes.prior is no text"


def refuse_components(
    record: Record, protocol: LoadedProtocol, host: PluginHost, where: str
) -> None:
    """Raise UserError where model, encoder, sensors or plugins are not what ships under their name.

    Models and encoders of others are their word; those that ship are checked by what they declare.
    """
    if record.regime not in protocol.spec.regimes:
        raise UserError(
            f"{where}: regime {record.regime!r} is none of protocol {protocol.spec.id!r}; it has "
            f"{', '.join(protocol.spec.regimes)}."
        )
    known: set[str] = set()
    others = 0
    components = (
        ("model", record.model, host.models),
        ("encoder", record.encoder, host.encoders),
        ("sensor", record.sensor, host.sensors),
        ("sensor.tested", record.test_sensor, host.sensors),
    )
    for place, component, catalogue in components:
        if component is None:
            continue
        spec: Any = catalogue.specs.get(component.name)
        if spec is None:
            if place.startswith("sensor"):
                raise UserError(
                    f"{where}: sensor {component.name!r} does not ship with tactibench, so its "
                    "presses cannot be made again here; only runs on sensors that do can be "
                    "verified."
                )
            others += 1
            _refuse_settings(component, f"{where}: {place}")
            continue
        known.add(catalogue.origins[component.name].plugin)
        _refuse_parameters(spec, component, f"{where}: {place}", test=place == "sensor.tested")
    stated = record.identity.plugins
    for name in sorted(known):
        if name not in stated or stated[name]["distribution"] != OURS:
            raise UserError(
                f"{where}: identity.plugins does not say that {name!r} is of tactibench, whose "
                "model, encoder or sensor the record names."
            )
    strangers = set(stated) - known
    of_ours = [name for name in sorted(strangers) if stated[name]["distribution"] == OURS]
    if of_ours or len(strangers) > others or (others and not strangers):
        raise UserError(
            f"{where}: identity.plugins names {', '.join(sorted(stated)) or 'none'}, but the "
            f"record's components are of {', '.join(sorted(known)) or 'others'}"
            f"{f' and {others} of others' if others else ''}."
        )
    _refuse_model(record, protocol, host, where)


def _refuse_model(record: Record, protocol: LoadedProtocol, host: PluginHost, where: str) -> None:
    model: ModelSpec | None = host.models.specs.get(record.model.name)
    if model is None:
        return
    if protocol.spec.answer not in model.answers:
        raise UserError(
            f"{where}: model {model.name!r} answers {' and '.join(model.answers)}, but the "
            f"protocol asks for {protocol.spec.answer}."
        )
    if model.uses_encoder != (record.encoder is not None):
        what = "uses an encoder" if model.uses_encoder else "uses no encoder"
        raise UserError(f"{where}: model {model.name!r} {what}, but the record says otherwise.")
    draws = [protocol.spec.draw(name) for name in protocol.spec.regimes[record.regime]]
    if model.max_contacts == 1 and any(draw.indenter != "single" for draw in draws):
        raise UserError(
            f"{where}: model {model.name!r} predicts one contact per frame and is not trained in "
            f"regime {record.regime!r}, whose frames hold several."
        )
    encoder = record.encoder and host.encoders.specs.get(record.encoder.name)
    if encoder and encoder.kind not in model.encoders:
        raise UserError(
            f"{where}: encoder {encoder.name!r} is of kind {encoder.kind!r}, which model "
            f"{model.name!r} does not learn."
        )


def _refuse_parameters(
    spec: ModelSpec | EncoderSpec | SensorSpec, component: Component, where: str, *, test: bool
) -> None:
    """Raise UserError for parameters that the spec does not have, or does not allow."""
    try:
        today = spec.settings_of_record(component.parameters)
    except UserError as error:
        raise UserError(f"{where}: {error}") from None
    defaults = spec.defaults(today)
    must, may = set(), set()
    for parameter in spec.parameters:
        name = parameter.name
        if name not in component.parameters:
            if parameter.before is None:
                raise UserError(f"{where}.parameters lacks {name!r}, which every record states.")
            continue
        stated = component.parameters[name]
        replaced = str(stated) in spec.retired.get(name, {})
        # As it is written: 0 and 0.0 are one value and two rows of a board.
        if str(stated) == "-0.0":
            raise UserError(f"{where}.{name} is -0.0; write 0.0.")
        if not replaced and canonical(stated) != canonical(today[name]):
            raise UserError(f"{where}.{name} is {_short(stated)}, but is read as {today[name]!r}.")
        _refuse_file(parameter, stated, where)
        if isinstance(stated, str) and not (parameter.choices or TEXT.fullmatch(stated)):
            raise UserError(f"{where}.{name} is {_short(stated)}; it may be a name, or empty.")
        if stated != defaults[name]:
            may.add(name)
            if stated not in parameter.earlier and not replaced:
                must.add(name)
        elif parameter.earlier:
            may.add(name)
    for name in set(component.parameters) - {parameter.name for parameter in spec.parameters}:
        if isinstance(component.parameters[name], str):
            raise UserError(f"{where}.{name} is a text; it no longer is a parameter of that kind.")
    if not test:
        _refuse_settings(component, where)
        changed = set(component.changed)
        if not must <= changed or not changed <= may:
            raise UserError(
                f"{where}.settings names {', '.join(sorted(changed)) or 'nothing'} as changed, but "
                f"the parameters differ from their defaults in {', '.join(sorted(must)) or 'none'}."
            )


def _refuse_file(parameter: Parameter, stated: Any, where: str) -> None:
    if parameter.built_in and stated not in parameter.built_in:
        raise UserError(
            f"{where}.{parameter.name} is {_short(stated)}, which names a file; nothing that a "
            "record names is opened, so a run on it cannot be verified."
        )


def _refuse_settings(component: Component, where: str) -> None:
    settings = component.settings
    if settings is not None and (
        len(set(settings)) < len(settings) or not set(settings) <= set(component.parameters)
    ):
        raise UserError(f"{where}.settings is {_short(settings)}; it names parameters, each once.")


def refuse_underived(
    record: Record, derived: Derived, protocol: LoadedProtocol, where: str
) -> None:
    """Raise UserError where a record does not state what was derived of it."""
    identity = record.identity
    because = "its protocol, options and sensors give"
    pairs: list[tuple[str, Any, Any]] = [
        ("protocol.title", record.protocol.title, protocol.spec.title),
        ("identity.hidden", identity.hidden, derived.hidden),
        ("identity.shots", identity.shots is not None, derived.shots),
        ("sets of frames in identity.data", len(identity.data or []), derived.sets),
        ("sets of frames in identity.test_frames", len(identity.test_frames), derived.sets),
    ]
    stated = record.sensor.json_values()
    tested: Mapping[str, Any] | None = derived.sensor.get("tested")
    pairs.append(("sensor.tested", "tested" in stated, tested is not None))
    pairs += [
        (f"sensor.{name}", stated.get(name), derived.sensor.get(name))
        for name in ("origin", "range")
    ]
    recording = derived.sensor.get("recording")
    # Of a recording that is not here, its submitter alone says what it was.
    if (said := stated.get("recording")) is not None and derived.trained:
        # Where a folder lies is its owner's; what is in it is not.
        pairs += [
            (f"sensor.recording.{name}", said[name], recording and recording[name])
            for name in ("sha256", "sensor")
        ]
        if not LABEL.fullmatch(said["label"]):
            raise UserError(f"{where}: sensor.recording.label is {_short(said['label'])}.")
    for key, one, other in pairs:
        if not same(one, other):
            raise _differs(where, key, one, other, because)
    if tested is not None:
        _refuse_tested(record, tested, derived.tested_values or {}, where, because)
    _refuse_data(record, derived, where, because)
    for released in identity.released:
        if not any(same(released, known) for known in derived.released):
            raise UserError(
                f"{where}: identity.released holds {_short(released)}, which was not published for "
                "these test frames."
            )


def _refuse_tested(
    record: Record,
    tested: Mapping[str, Any],
    values: Mapping[str, Any],
    where: str,
    because: str,
) -> None:
    test = record.test_sensor
    assert test is not None  # noqa: S101 - the caller looked
    folders = [text for text in test.options if text.startswith(f"{DATA}=")]
    trained_on = tested.get("trained_on")
    if trained_on == "":  # on a recording that is not here
        label = (test.trained_on or "").removeprefix("real recording ")
        if not LABEL.fullmatch(label) or label == test.trained_on:
            raise UserError(f"{where}: sensor.tested.trained_on is {_short(test.trained_on)}.")
        trained_on = test.trained_on
    pairs = (
        ("name", test.name, tested["name"]),
        ("asked", test.options, tested["asked"]),
        ("on", test.description, tested["on"]),
        ("presses", test.presses, tested["presses"]),
        ("trained_on", test.trained_on, trained_on),
    )
    for name, one, other in pairs:
        if not same(one, other):
            raise _differs(where, f"sensor.tested.{name}", one, other, because)
    if any(not LABEL.fullmatch(text.partition("=")[2]) for text in folders):
        raise UserError(f"{where}: sensor.tested.asked names a folder by more than two names.")
    for name, value in test.parameters.items():
        if name in values and canonical(value) != canonical(values[name]):
            key = f"sensor.tested.parameters.{name}"
            raise _differs(where, key, value, values[name], because)


def _refuse_data(record: Record, derived: Derived, where: str, because: str) -> None:
    data = record.data
    names = ["test", "published_frames"]
    if derived.trained:
        names += ["train", "validation", "rejected"]
    pairs = [(f"data.{name}", getattr(data, name), derived.data[name]) for name in names]
    if data.simulator and "simulator" in derived.data:
        stated = [error.json_values() for error in data.simulator]
        pairs.append(("data.simulator", stated, derived.data["simulator"]))
    seen = data.of_tested_sensor
    expected = derived.data.get("of_tested_sensor")
    pairs.append(("data.of_tested_sensor", seen is not None, expected is not None))
    if seen is not None and expected is not None:
        pairs += [
            (f"data.of_tested_sensor.{name}", getattr(seen, name), value)
            for name, value in expected.items()
            if name != "described"
        ]
        described = expected.get("described", {})
        pairs += [
            (f"data.of_tested_sensor.described.{name}", value, described.get(name))
            for name, value in seen.described.items()
            if name not in ("folder", "label")
        ]
        shown = [step.get("shots") for step in seen.adapted]
        if seen.adapted:
            pairs.append(("data.of_tested_sensor.adapted", shown, seen.labelled_frames))
    for key, one, other in pairs:
        slack = FIT_SLACK if ".described." in key else SLACK
        if not same(one, other, slack):
            raise _differs(where, key, one, other, because)


def refuse_too_many(record: Record, host: PluginHost, most: int, where: str) -> None:
    """Raise UserError where a model that ships answers with more contacts than it can."""
    model = host.models.specs.get(record.model.name)
    if model is not None and model.max_contacts is not None and most > model.max_contacts:
        raise UserError(
            f"{where}: a frame is answered with {most} contacts, but model {model.name!r} gives "
            f"{model.max_contacts} at most."
        )


def refuse_failures(record: Record, derived: Mapping[str, Any] | None, where: str) -> None:
    """Raise UserError unless a record counts the failures that lie with its answers.

    derived: what ``failures_record`` gives of them; None where a failure ends the run.
    """
    failures = record.data.failures
    stated = None if failures is None else failures.json_values()
    if not same(stated, derived):
        raise _differs(where, "data.failures", stated, derived, "its answers give")


def on_word(derived: Derived) -> Sequence[str]:
    """Return what is the submitter's word in a record that was not refused."""
    words = ["the model", "its training", "weights", "times", "hashes of frames"]
    if not derived.trained:
        words.append("numbers of training frames")
    return words
