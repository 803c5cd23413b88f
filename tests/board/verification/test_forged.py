"""Forged submissions: a committed one with one untruth in it is refused with a sentence."""

from __future__ import annotations

import json
from pathlib import Path

import forged
import pytest
from forged_files import FILES
from forged_records import FORGERIES

from tactibench import UserError
from tactibench.board import Source, refuse_forms, score_again, trusted_host
from tactibench.records import parse_record

pytestmark = pytest.mark.filterwarnings("ignore:Duplicate name:UserWarning")


@pytest.fixture(scope="module")
def trusted(tmp_path_factory: pytest.TempPathFactory) -> Source:
    return Source(trusted_host(), tmp_path_factory.mktemp("cache"))


@pytest.mark.long
@pytest.mark.parametrize("base", sorted(forged.BASES))
def test_what_is_forged_was_right_before(base: str, trusted: Source) -> None:
    assert score_again(forged.base_file(base), trusted).frames > 0


@pytest.mark.long
@pytest.mark.parametrize("forgery", FORGERIES, ids=lambda one: one.name)
def test_forged_provenance_is_refused(
    forgery: forged.Forgery, trusted: Source, tmp_path: Path
) -> None:
    with pytest.raises(UserError):
        score_again(forged.forge(forgery, tmp_path), trusted)


@pytest.mark.parametrize("key", ["label", "sensor"])
@pytest.mark.parametrize("said", ["<b>mine</b>", "a|b", "x" * 200])
def test_names_of_a_recording_are_no_markup(key: str, said: str) -> None:
    """Its pixels are not here, so that nothing else of it is looked at before."""
    folder = forged.ROOT / "leaderboards" / "submissions" / "exp1"
    path = next(folder.glob("exp1-kernel-single-s0-ed7421df.json"))
    values = json.loads(path.read_text(encoding="utf-8"))
    record = parse_record(values, "it")
    refuse_forms(record, values, "it")
    values["sensor"]["recording"][key] = said
    values["identity"].pop("sealed", None)
    with pytest.raises(UserError, match=rf"sensor\.recording\.{key} is"):
        refuse_forms(parse_record(values, "it"), values, "it")


@pytest.mark.long
@pytest.mark.parametrize("base", ["plain", "instance"])
def test_every_value_is_derived_or_the_submitters_word(
    base: str, trusted: Source, tmp_path: Path
) -> None:
    accepted = set()
    for forgery in forged.key_forgeries(base):
        try:
            score_again(forged.forge(forgery, tmp_path), trusted)
        except UserError:
            continue
        accepted.add(forgery.name)
    assert {name for name in accepted if not name.startswith(forged.ON_WORD)} == set()


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.long] if name.startswith("answers:") else [])
        for name in FILES
    ],
)
def test_forged_files_are_refused(name: str, trusted: Source, tmp_path: Path) -> None:
    with pytest.raises(UserError):
        score_again(FILES[name](tmp_path), trusted)


def test_another_exception_is_a_verdict_on_that_file(
    trusted: Source, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from tactibench.board import verification

    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of a file")

    monkeypatch.setattr(verification, "score_again", broken)
    with pytest.raises(UserError, match=r"could not be scored again \(ZeroDivisionError: of a"):
        verification.verify(tmp_path / "it.json", trusted)
