"""A data set that a sensor presses: the frames of a run, however often it was interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from folder_files import CLOCKED, files
from stubs import StubSensor

from tactibench import Contacts, Frame, Indenter, Pose, Scene, SensorContext, UserError
from tactibench.datasets import (
    Press,
    PressPlan,
    PressSeries,
    SensorSource,
    generate,
    generation,
    is_complete,
    open_dataset,
    plan_of_file,
    plan_of_protocol,
    press_rows,
    sensor_source,
    verify,
)
from tactibench.frames import GeneratedFrameSet
from tactibench.frames import cache as generated
from tactibench.geometry import tip_depths
from tactibench.plugins import PluginHost
from tactibench.protocols import Protocol, load_protocol

SHAPE = (6, 5)
CHUNK = 7


class Noise(StubSensor):
    """Frames are noise of the seed and the press's number; reaches 0.25 mm further than asked."""

    fail_at: int | None = None
    presses = 0
    tells_force = False

    def __init__(self, context: SensorContext) -> None:
        self._seed = context.seed

    def __enter__(self) -> Noise:
        self._rng = np.random.default_rng(self._seed)
        return self

    def _image(self) -> np.ndarray:
        return self._rng.integers(0, 256, SHAPE, dtype=np.uint8)

    def rest(self) -> Frame:
        return Frame(np.zeros(SHAPE, np.uint8), 0.0, Pose())

    def press_many(self, scenes: Any) -> Any:
        for scene in scenes:
            if type(self).fail_at == type(self).presses:
                raise KeyboardInterrupt
            type(self).presses += 1
            pose = scene.pose
            reached = Pose(pose.x + 0.25, pose.y, pose.yaw, pose.tilt, pose.depth)
            touching = int((tip_depths(scene) > 0).sum())
            force = self._rng.normal(size=(touching, 3)) if self.tells_force else None
            yield Frame(self._image(), 0.0, reached, None, force)

    def describe(self) -> dict[str, Any]:
        return {"kind": "noise"}


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (generated, generation):
        monkeypatch.setattr(module, "CHUNK", CHUNK)
    monkeypatch.setattr(generation, "GROUP", 3)
    monkeypatch.setattr(Noise, "fail_at", None)
    monkeypatch.setattr(Noise, "presses", 0)


@pytest.fixture
def source() -> SensorSource:
    return SensorSource(Noise, {"name": "noise"}, 20.0, {"seed": 5})


def presses(count: int, start: int = 0) -> tuple[Press, ...]:
    """Presses of two contacts, one, or none."""
    return tuple(
        Press(n, f"p{n}", Scene(Indenter.dual(7.0), Pose(0.4 * n - 1, depth=1.5 - 0.2 * n)), "draw")
        for n in range(start, start + count)
    )


@pytest.fixture
def small() -> PressPlan:
    series = (PressSeries(presses(17), (5, 1, 0)), PressSeries(presses(4, 17), (5, 2, 3)))
    split = {"train": range(17), "validation": [], "test": range(17, 21)}
    return PressPlan(series, {"both": split})


@pytest.mark.parametrize("tells_force", [False, True])
def test_frames_are_those_of_the_cache(
    tmp_path: Path,
    source: SensorSource,
    small: PressPlan,
    monkeypatch: pytest.MonkeyPatch,
    tells_force: bool,
) -> None:
    monkeypatch.setattr(Noise, "tells_force", tells_force)
    told: list[int] = []
    generate(tmp_path / "set", source, small, told.append)
    dataset = open_dataset(tmp_path / "set")
    assert sum(told) == len(dataset.samples) == 21
    for series in small.series:
        request = GeneratedFrameSet(
            role="fit",
            name="x",
            scenes=tuple(p.scene for p in series.presses),
            groups=(),
            names=tuple(p.name for p in series.presses),
            build=Noise,
            identity={},
            seed=series.seed,
            cache=tmp_path / "cache",
        )
        made = request.open(lambda _: None)
        truth = made.truth("contacts", 20.0)
        for press, frame, true in zip(series.presses, made.frames, truth, strict=True):
            sample = dataset.samples[press.id]
            assert (sample.press, sample.extra) == (press.name, {"draw": "draw"})
            assert sample.scene is not None
            assert sample.scene.pose == frame.pose  # the one that was reached
            assert np.array_equal(dataset.signal(sample), frame.image)
            contacts = dataset.contacts(sample)
            assert isinstance(true, Contacts)
            assert contacts is not None
            assert (contacts.force is not None) == (true.force is not None) == tells_force
            if tells_force:
                assert contacts.force.shape == (len(true), 3)
                assert np.array_equal(contacts.force, true.force)
    assert dataset.rest is not None
    assert dataset.splits["both"].test == (17, 18, 19, 20)
    assert verify(tmp_path / "set") == []


@pytest.mark.parametrize("stops", [[0], [7], [3, 9, 20]])
def test_interruptions_change_nothing(
    tmp_path: Path,
    source: SensorSource,
    small: PressPlan,
    stops: list[int],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    generate(tmp_path / "whole", source, small, lambda _: None)
    for stop in stops:
        monkeypatch.setattr(Noise, "presses", 0)
        monkeypatch.setattr(Noise, "fail_at", stop % 4)  # of the shortest chunk
        with pytest.raises(KeyboardInterrupt):
            generate(tmp_path / "set", source, small, lambda _: None)
        assert not is_complete(tmp_path / "set", source, small)
    monkeypatch.setattr(Noise, "fail_at", None)
    generate(tmp_path / "set", source, small, lambda _: None)
    assert is_complete(tmp_path / "set", source, small)
    one, whole = (files(tmp_path / name, without=CLOCKED) for name in ("set", "whole"))
    assert one == whole


def shrunk(name: str) -> Protocol:
    spec = load_protocol(name).spec
    draws = tuple(
        draw.model_copy(update={"count": 20} if draw.count else {"per_distance": 2})
        for draw in spec.draws
    )
    assert spec.split is not None
    split = spec.split.model_copy(update={"test": 4, "validation": 3})
    return spec.model_copy(update={"draws": draws, "split": split})


HELD_OUT = {"exp1": (), "exp2": ("between", "uneven"), "exp3": ("three", "four", "five")}
"""Draws that the sensor itself is tested on, apart from the others."""


@pytest.mark.parametrize("name", ["exp1", "exp2", "exp3"])
@pytest.mark.parametrize("count", [None, 2])
def test_all_that_a_protocol_needs_is_pressed(name: str, count: int | None) -> None:
    spec = shrunk(name)
    asked = plan_of_protocol(spec, StubSensor(), count)
    every = list(asked)
    assert [press.id for press in every] == list(range(len(every)))
    assert len({press.name for press in every}) == len(every)
    assert set(asked.splits) == {f"{name}-{regime}" for regime in spec.regimes}
    for regime, extra in spec.regimes.items():
        split = asked.splits[f"{name}-{regime}"]
        draws = {part: {every[n].draw for n in ids} for part, ids in split.items()}
        assert draws["train"] == {spec.split.draw, *extra}  # type: ignore[union-attr]
        assert draws["validation"] == {spec.split.draw}  # type: ignore[union-attr]
        assert draws["test"] == {*spec.test.sets, *HELD_OUT[name]}
        flat = [number for ids in split.values() for number in ids]
        assert len(flat) == len(set(flat))
        assert len(split["validation"]) == (count or 3)
    used = {n for split in asked.splits.values() for ids in split.values() for n in ids}
    assert used == set(range(len(every)))


def test_a_protocol_without_draws_is_refused() -> None:
    with pytest.raises(UserError, match="'surface' takes the presses of a recorded folder"):
        plan_of_protocol(load_protocol("surface").spec, StubSensor(), None)


def test_a_plan_file_says_what_plan_jsonl_says(tmp_path: Path, small: PressPlan) -> None:
    import json

    file = tmp_path / "plan.jsonl"
    file.write_text("".join(json.dumps(row) + "\n" for row in press_rows(small)))
    read = plan_of_file(file, 3, None)
    assert [list(series.presses) for series in read.series] == [list(small)]
    assert read.series[0].seed == (3,)
    assert len(list(plan_of_file(file, 3, 5))) == 5


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("{", "line 2 is no JSON object"),
        ('{"id": 0, "indenter": "single", "x_mm": 0, "y_mm": 0, "depth_mm": 1}', "row 2"),
        ('{"id": 1, "x_mm": 0, "y_mm": 0, "depth_mm": 1}', "line 2: a pose needs"),
        ('{"id": 1, "indenter": "single", "x_mm": 0, "y_mm": 0}', "line 2: the key 'depth_mm'"),
        ('{"id": 1, "indenter": "a", "x_mm": 0, "y": 0, "depth_mm": 1}', "line 2: unknown key 'y'"),
        ('{"id": 1, "indenter": "a", "x_mm": NaN}', "row 2 of .*plan.jsonl cannot be written"),
    ],
)
def test_a_mistake_in_a_plan_names_its_line(tmp_path: Path, line: str, says: str) -> None:
    good = '{"id": 0, "indenter": "plate", "x_mm": 0, "y_mm": 0, "depth_mm": 1, "tilt_deg": 5}'
    file = tmp_path / "plan.jsonl"
    file.write_text(f"{good}\n{line}\n")
    with pytest.raises(UserError, match=says):
        plan_of_file(file, 0, None)


def test_an_empty_or_missing_plan(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is no file"):
        plan_of_file(tmp_path / "plan.jsonl", 0, None)
    (tmp_path / "plan.jsonl").touch()
    with pytest.raises(UserError, match="is empty"):
        plan_of_file(tmp_path / "plan.jsonl", 0, None)


def test_a_source_says_what_determines_its_frames() -> None:
    spec = PluginHost().sensors["tactip-127"]
    source = sensor_source(spec, {"size": 32})
    assert source.dome_radius_mm == 20.0
    assert source.identity["parameters"] == {"size": 32}
    assert len(source.identity["code"]) == 64
    with source.build(SensorContext(np.random.SeedSequence(0))) as sensor:
        assert sensor.rest().image.shape == (32, 32)
