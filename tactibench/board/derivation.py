"""The facts that a record must state, derived from its protocol, its options and its sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import isinf
from typing import Any

from tactibench.frames import FrameRequest, FrameSource, TransferFrames, simulator_error
from tactibench.protocols import HiddenSeed
from tactibench.records import Arrays, Record
from tactibench.run import DATA, TestOptions, find_published, target_record


@dataclass(frozen=True)
class Derived:
    """Everything that protocol, options and sensors of a record determine, in the keys of a record.

    Attributes:
        sensor: Keys of ``sensor`` but its parameters. "tested" is there where another sensor was
            tested.
        tested_values: Today's parameters of the tested sensor; None where it is the training one.
        data: Keys of ``data``.
        sets: Number of sets of test frames.
        hidden: Hash of the hidden seed.
        released: Published predictions that the run may have been compared with.
        trained: Whether the training frames are known here.
        shots: Whether labelled frames were shown.
    """

    sensor: Mapping[str, Any]
    tested_values: Mapping[str, Any] | None
    data: Mapping[str, Any]
    sets: int
    hidden: str | None = None
    released: tuple[Mapping[str, Any], ...] = ()
    trained: bool = True
    shots: bool = False


@dataclass(frozen=True)
class Facts:
    """The facts of a plan that a record states, without its scenes.

    Attributes:
        data: Keys of ``data`` in a record.
        sets: Number of sets of test frames.
        describe: Description that the training sensor gives of itself; None where its recording is
            not here.
        range: Range that was pressed in place of the protocol's; None: the protocol's.
        calibrated: Number of frames left out, because the training sensor was fitted to them.
        released: Published predictions that the run may have been compared with.
        target: Description of the recording that was tested; empty for drawn presses.
    """

    data: dict[str, Any]
    sets: int
    describe: Mapping[str, Any] | None
    range: dict[str, Any] | None
    calibrated: int
    released: tuple[Mapping[str, Any], ...] = ()
    target: Mapping[str, Any] = field(default_factory=dict)


def read_facts(frames: FrameSource) -> Facts:
    """Return the facts of a source of frames.

    Raises:
        UserError: The source cannot plan its frames.
    """
    request, tested = frames.request, frames.request.tested.spec
    target = frames.target.identity["describe"] if isinstance(frames, TransferFrames) else {}
    if isinstance(frames, TransferFrames) and frames.simulated is None:
        # The recording that trained is not here: --data names the one that was tested.
        sets = frames.test_frames()
        tests = {"test": sum(len(presses.scenes) for presses in sets), "published_frames": False}
        return Facts(tests, len(sets), None, None, 0, target=target)
    plan = frames.plan()
    counts: dict[str, Any] = {
        "train": plan.count("fit"),
        "validation": plan.count("validation"),
        "test": plan.count("test"),
        "rejected": plan.rejected,
        "published_frames": frames.published,
    }
    if tested.origin != "simulated" or tested.reference_of:
        counts["simulator"] = []
    else:
        errors = [simulator_error(frame_set) for frame_set in plan.test]
        counts["simulator"] = [error for error in errors if error is not None]
    space = None
    if plan.workspace is not None:
        radius = plan.workspace.dome_radius_mm
        space = {**asdict(plan.workspace), "dome_radius_mm": None if isinf(radius) else radius}
    released: tuple[Mapping[str, Any], ...] = ()
    if frames.published:
        released = tuple(
            prediction.identity
            for prediction in find_published(request.protocol, request.data, None)
        )
    describe = plan.sensor_identity["describe"]
    return Facts(counts, len(plan.test), describe, space, plan.calibrated, released, target)


def derive(
    record: Record,
    options: TestOptions,
    request: FrameRequest,
    facts: Facts,
    truth: Arrays,
    hidden: HiddenSeed | None,
) -> Derived:
    """Return the facts that a record must state.

    Args:
        record: The record that is checked.
        options: Options of its test.
        request: Frames that it was made from.
        facts: Facts of the plan of these frames.
        truth: Packed truth of the test frames.
        hidden: Hidden seed of the test presses; None: the protocol's seed.
    """
    origin, describe = request.sensor.spec.origin, facts.describe or {}
    if describe.get("origin") == "simulated":
        origin = "simulated"
    sensor: dict[str, Any] = {"origin": origin, "range": facts.range}
    if request.sensor.spec.needs_data and {"folder", "sha256"} <= set(describe):
        sensor["recording"] = {
            "sha256": describe["sha256"],
            "sensor": str(describe.get("recorded_with", "")),
        }
    tested = request.test_sensor
    if tested is not None:
        presses = len(set(truth["press"].tolist()))
        sensor["tested"] = target_record(tested, request.sensor, options, presses, None)
        if options.data is not None:
            stated = [] if record.test_sensor is None else record.test_sensor.options
            sensor["tested"] |= _as_labelled(stated, sensor["tested"])
            if request.sensor.spec.needs_data:
                sensor["tested"]["trained_on"] = ""
    data = dict(facts.data)
    if request.spec.transfer is not None:
        seen = record.data.of_tested_sensor
        data["of_tested_sensor"] = {
            "rest_image": True,
            "unlabelled_frames": 0,
            "labelled_frames": [] if seen is None else seen.labelled_frames,  # checked before
            "left_out_calibrated": facts.calibrated,
            "described": facts.target,
        }
    elif options.shots:
        data["of_tested_sensor"] = {
            "rest_image": True,
            "unlabelled_frames": 0,
            "labelled_frames": [options.shots],
        }
    return Derived(
        sensor=sensor,
        tested_values=None if tested is None else tested.values,
        data=data,
        sets=facts.sets,
        hidden=None if hidden is None else hidden.commitment,
        released=facts.released,
        trained=facts.describe is not None,
        shots=bool(options.shots) or request.spec.transfer is not None,
    )


def _as_labelled(stated: Sequence[str], tested: Mapping[str, Any]) -> dict[str, Any]:
    """Return options and description with the name that the submitter gave to the folder."""
    ours = next(text for text in tested["asked"] if text.startswith(f"{DATA}="))
    theirs = next(text for text in stated if text.startswith(f"{DATA}="))
    asked = [theirs if text == ours else text for text in tested["asked"]]
    label, other = (text.partition("=")[2] for text in (ours, theirs))
    return {"asked": asked, "on": tested["on"].replace(f"recording {label}", f"recording {other}")}
