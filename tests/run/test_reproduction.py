"""A committed record is reproduced by its request, and a record that says more is not."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from changed_record import listed_tables

from tactibench import UserError, api
from tactibench.board import (
    add,
    note_reproduction,
    read_submission,
    reproduce,
    reproduction_rows,
    request_of_record,
)
from tactibench.plugins import PluginHost
from tactibench.records import StoredRun, parse_record
from tactibench.run import NullReporter, TestOptions, WorkerHost, execute

COMMITTED = Path(__file__).parents[2] / "leaderboards" / "submissions"


@pytest.fixture
def submitted(
    run: Callable[..., StoredRun], mini: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., Path]:
    """Keywords of a request -> the record of its run, committed."""
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(Path(mini("exp1")).parent))
    return lambda **more: add(run("exp1", **more), tmp_path / "board")[0]


@pytest.fixture(scope="module")
def plugins() -> PluginHost:
    """The plugins that are installed."""
    return PluginHost()


def test_the_parameters_of_a_row_of_named_places_are_kept(plugins, tmp_path) -> None:
    path = next((COMMITTED / "sites").glob("sites-kernel-*.json"))
    record = read_submission(path)
    record.model.parameters["mixing"] = False
    request = request_of_record(record, plugins, tmp_path)
    assert request.parameters["model"] == {"mixing": "False"}


def test_a_run_is_made_again_and_noted(submitted, host, tiny, installed, tmp_path) -> None:
    path = submitted(presses=20, parameters={"sensor": {"offset": "2"}})
    trained = len(tiny.TinyModel.fits)
    found = reproduce(path, host, NullReporter(), cache=tmp_path / "cache")
    assert len(tiny.TinyModel.fits) == trained
    assert (found.reproduced, found.same_frames) == (True, True)
    assert all(row["within"] for row in reproduction_rows(found))
    before = read_submission(path)
    assert before.reproduced is None
    note = note_reproduction(found, "a lab")
    after = read_submission(path)
    assert (after.reproduced, after.metrics) == (note, before.metrics)
    assert note.by == "a lab"


def test_a_worker_answers_as_the_model_does_in_this_process(
    run, submitted, host, installed, tmp_path
) -> None:
    path = submitted()
    found = reproduce(path, host, NullReporter(), cache=tmp_path / "cache")
    assert found.again.identity.predictions_hash == found.record.identity.predictions_hash
    assert found.again.metrics == found.record.metrics


def test_a_better_error_than_that_of_the_run_is_not_reproduced(
    submitted, host, installed, tmp_path
) -> None:
    path = submitted()
    record = listed_tables(path.read_text(encoding="utf-8"))
    del record["identity"]["sealed"]
    (row,) = (
        r for r in record["metrics"] if (r["metric"], r["group"]) == ("gospa_depth_mm", "all")
    )
    row |= {"value": row["value"] / 10, "low": row["low"] / 10, "high": row["high"] / 10}
    path.write_text(json.dumps(record), encoding="utf-8")
    found = reproduce(path, host, NullReporter(), cache=tmp_path / "cache")
    outside = [one for one in found.metrics if not one.within]
    assert [(one.stated.metric, one.decides) for one in outside] == [("gospa_depth_mm", True)]
    assert not found.reproduced
    with pytest.raises(UserError, match="was not reproduced"):
        note_reproduction(found, "a lab")
    assert read_submission(path).reproduced is None


@pytest.mark.parametrize(
    ("runner", "said"),
    [
        ("no-such-command", "cannot be started"),
        (f"{sys.executable} -c 'print(1)'", "ended"),
        (f"{sys.executable} -P -m tactibench.run.worker", ""),
    ],
)
def test_a_runner_starts_the_worker(runner, said, submitted, host, installed, tmp_path) -> None:
    path = submitted()
    with pytest.raises(UserError, match=said) if said else nullcontext():
        reproduce(path, host, NullReporter(), cache=tmp_path / "cache", runner=runner)


@pytest.mark.long
def test_the_command_trains_anew_and_compares(submitted, monkeypatch, tmp_path, run) -> None:
    """With the plugins that ship: nothing is in a cache, the training is another process."""
    plan = api.plan(os.environ["TACTIBENCH_PROTOCOLS"] + "/few-exp1.toml", "mean", store=tmp_path)
    path = add(execute(plan, NullReporter()), tmp_path / "board")[0]
    found = reproduce(path, WorkerHost(""), NullReporter())
    assert found.reproduced
    assert found.same_frames
    assert found.again.metrics == found.record.metrics


@pytest.mark.usefixtures("submitted")  # its protocol is found
def test_the_request_of_a_record_is_that_of_its_run(run, host, tmp_path) -> None:
    test = TestOptions(parameters={"offset": "3"})
    made = run("exp1", regime="multiple", seed=4, presses=20, test=test).record
    request = request_of_record(made, host, None)
    assert (request.regime, request.seed, request.presses, request.test) == (
        "multiple",
        4,
        20,
        test,
    )
    made.sensor.name = "recorded"
    with pytest.raises(UserError, match="read a recording; name its folder, or one above it"):
        request_of_record(made, host, None)
    folder = tmp_path / "data" / "skin"
    folder.mkdir(parents=True)
    assert request_of_record(made, host, folder).data == folder


@pytest.mark.usefixtures("submitted")  # its protocol is found
def test_the_recording_is_found_by_its_name_above_it(run, host, tmp_path) -> None:
    made = run("exp1").record
    recording = {"label": "plates", "sha256": "0" * 64}
    sensor = {**made.sensor.json_values(), "name": "recorded", "recording": recording}
    made = parse_record({**made.json_values(), "sensor": sensor}, "a record")
    for sensor in ("one", "other"):
        (tmp_path / sensor / "plates").mkdir(parents=True)
    for given in (tmp_path / "one", tmp_path / "one" / "plates"):
        assert request_of_record(made, host, given).data == tmp_path / "one" / "plates"
    with pytest.raises(UserError, match=r"several recordings 'plates'; name one: --data .*other"):
        request_of_record(made, host, tmp_path)


def test_another_recording_than_that_of_the_record_is_refused(submitted, host) -> None:
    path = submitted()
    record = json.loads(path.read_text(encoding="utf-8"))
    del record["identity"]["sealed"]
    record["sensor"]["recording"] = {"label": "plates", "sha256": "0" * 64}
    path.write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(UserError, match="None is not the recording that"):
        reproduce(path, host, NullReporter())


@pytest.mark.parametrize("protocol", [p.name for p in sorted(COMMITTED.iterdir())])
def test_every_committed_record_can_be_made_again(protocol, plugins, tmp_path) -> None:
    """Plugins that ship are here and have exactly the parameters that it holds."""
    for path in (COMMITTED / protocol).glob("*.json"):
        record = read_submission(path)
        if record.model.name not in plugins.models:  # of somebody else, who installs it
            continue
        request = request_of_record(record, plugins, tmp_path)
        for kind in ("model", "sensor", "encoder"):
            part = getattr(record, kind)
            assert part is None or request.parameters[kind].keys() == part.parameters.keys(), path
