"""Hidden presses: drawn from a secret, keyed and recorded by hashes alone."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactibench import UserError
from tactibench.board import add, command_options, reproduce, section_key
from tactibench.protocols import (
    HiddenSeed,
    commitment_file,
    commitment_text,
    committed_seed,
    given_seed,
    load_protocol,
    recorded_seed,
)
from tactibench.protocols.loader import SEED_VARIABLE
from tactibench.records import StoredRun
from tactibench.run import NullReporter, TestOptions

pytestmark = pytest.mark.long

SECRET = "5eed" * 16
HIDDEN = TestOptions(hidden=True)


@pytest.fixture
def committed(mini: Callable[[str], str], tmp_path: Path, monkeypatch: Any) -> HiddenSeed:
    """The seed in the environment, its hash published in the boards of the present folder."""
    monkeypatch.setenv(SEED_VARIABLE, SECRET)
    (tmp_path / "leaderboards/hidden").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    protocol = load_protocol(mini("exp1"))
    seed = given_seed(protocol)
    commitment_file(protocol, seed.commitment).write_text(commitment_text(protocol, seed))
    return seed


def test_a_hidden_run_is_tested_on_other_presses_with_the_same_weights(
    run: Callable[..., StoredRun], committed: HiddenSeed, installed: None
) -> None:
    public, secret = run("exp1"), run("exp1", test=HIDDEN)
    one, other = (done.record.identity for done in (public, secret))
    assert one.weights == other.weights
    assert other.hidden == committed.commitment
    truth, hidden = public.arrays("truth")["xy"], secret.arrays("truth")["xy"]
    assert len(truth) == len(hidden) == 20
    assert not np.isin(hidden, truth).any()
    assert command_options(secret.record) == " --hidden-seed"
    assert secret.record.sensor.test_sensor.description == "hidden presses"
    assert section_key(public.record) != section_key(secret.record)
    assert "-on-hidden-" in secret.record.name


def test_a_hidden_run_is_made_again_when_its_seed_is_revealed(
    run: Callable[..., StoredRun],
    mini: Callable[[str], str],
    host: Any,
    committed: HiddenSeed,
    installed: None,
    tmp_path: Path,
    monkeypatch: Any,
) -> None:
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(Path(mini("exp1")).parent))
    run("exp1")  # leaves the weights
    path = add(run("exp1", test=HIDDEN), tmp_path / "board")[0]
    monkeypatch.delenv(SEED_VARIABLE)
    with pytest.raises(UserError, match="a hidden seed is read from"):
        reproduce(path, host, NullReporter(), cache=tmp_path / "cache")
    protocol = load_protocol(mini("exp1"))
    published = commitment_file(protocol, committed.commitment)
    published.write_text(commitment_text(protocol, committed, reveal=True))
    found = reproduce(path, host, NullReporter(), cache=tmp_path / "cache")
    assert (found.reproduced, found.same_frames) == (True, True)


def test_neither_the_seed_nor_a_number_of_a_sensor_is_on_the_disk(
    run: Callable[..., StoredRun],
    mini: Callable[[str], str],
    committed: HiddenSeed,
    installed: None,
    tmp_path: Path,
) -> None:
    run("exp1", sensor="several")
    run("exp1", test=HIDDEN, sensor="several")
    number = committed.data_seed
    (unseen,) = committed.redraw(load_protocol(mini("exp1")).spec).test.apart
    numbers = [number, *unseen.instances]
    clear = [text.encode() for text in (SECRET, f"{number:x}", *map(str, numbers))]
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) > 10
    for path in files:
        content = path.read_bytes()
        assert not any(text in content or text in path.name.encode() for text in clear), path
    manifests = [path.read_text() for path in tmp_path.rglob("manifest.json")]
    assert not any('"seed": "hidden"' in text for text in manifests)  # nor are the presses
    assert SECRET not in repr(committed)


def test_hidden_sensors_are_others_in_groups_of_the_same_names(
    run: Callable[..., StoredRun],
    mini: Callable[[str], str],
    committed: HiddenSeed,
    installed: None,
) -> None:
    public, secret = (run("exp1", sensor="several", test=t) for t in (TestOptions(), HIDDEN))
    assert {row.group for row in public.record.metrics} == {
        row.group for row in secret.record.metrics
    }
    spec = load_protocol(mini("exp1")).spec
    (hidden,), (shown,) = committed.redraw(spec).test.apart, spec.test.apart
    assert len(set(hidden.instances) - set(shown.instances)) == len(shown.instances) == 8
    assert all(10**6 <= number < 10**9 for number in hidden.instances)
    other = HiddenSeed(committed.question, "another secret of thirty-two letters")
    assert not set(other.redraw(spec).test.apart[0].instances) & set(hidden.instances)


def test_seeds_of_protocols_and_versions_differ() -> None:
    asked = ("few-exp1@1 ab", "few-exp1@2 ab", "few-exp2@1 ab")
    seeds = [HiddenSeed(question, "x" * 32) for question in asked]
    assert len({seed.commitment for seed in seeds}) == len({seed.data_seed for seed in seeds}) == 3
    assert seeds[0].data_seed.bit_length() > 128
    assert f"{seeds[0].data_seed:064x}" != seeds[0].commitment


def test_another_seed_and_damaged_files_are_refused(
    committed: HiddenSeed, mini: Callable[[str], str], monkeypatch: Any
) -> None:
    protocol = load_protocol(mini("exp1"))
    path = commitment_file(protocol, committed.commitment)
    assert committed_seed(protocol) == committed
    text = path.read_text()
    path.write_text(text.replace(committed.commitment, committed.commitment[:8] + "0" * 56))
    with pytest.raises(UserError, match=r"no hash of the hidden seed .* was published"):
        committed_seed(protocol)
    path.write_text("=")
    with pytest.raises(UserError, match="is no TOML file"):
        committed_seed(protocol)
    path.write_text(text)
    monkeypatch.setenv(SEED_VARIABLE, SECRET[::-1])
    with pytest.raises(UserError, match=r"no hash of the hidden seed .* was published") as told:
        committed_seed(protocol)
    assert SECRET[::-1] not in str(told.value)


@pytest.mark.parametrize("secret", ['a "quoted" \\ seed of many characters, é 🙂'])
def test_a_revealed_seed_scores_answers_again_and_tests_no_new_model(
    secret: str, committed: HiddenSeed, mini: Callable[[str], str], monkeypatch: Any
) -> None:
    protocol = load_protocol(mini("exp1"))
    monkeypatch.setenv(SEED_VARIABLE, secret)
    seed = given_seed(protocol)
    path = commitment_file(protocol, seed.commitment)
    path.write_text(commitment_text(protocol, seed, reveal=True))
    with pytest.raises(UserError, match=r"was revealed in .*; take a new one"):
        committed_seed(protocol)
    monkeypatch.delenv(SEED_VARIABLE)
    assert recorded_seed(protocol, seed.commitment) == seed
    path.write_text(commitment_text(protocol, seed) + f'seed = "{SECRET[::-1]}"\n')
    with pytest.raises(UserError, match=f"in {path.name} is not the one with the hash"):
        recorded_seed(protocol, seed.commitment)
