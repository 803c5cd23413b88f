"""``submit``, ``verify`` and ``hidden`` on the command line."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

from tactibench.protocols.loader import SEED_VARIABLE

SECRET = "c0ffee" * 8


def test_submit_writes_two_files_and_no_page(cli, stored_run):
    name = stored_run()
    code, out, _ = cli("board", "submit", name)
    assert code == 0
    files = sorted(path.name for path in Path("leaderboards").rglob("*") if path.is_file())
    assert files == [f"{name}.json", f"{name}.npz"]
    assert f"`tactibench board verify leaderboards/submissions/exp1/{name}.json`" in out
    assert "in place of" in cli("board", "submit", stored_run(name="exp1-newer"))[1]


def test_verify_says_what_is_wrong_with_every_file(cli, stored_run):
    name = stored_run()
    cli("board", "submit", name)
    place = Path("leaderboards/submissions/exp1")
    code, out, _ = cli(
        "board", "verify", place / f"{name}.json", place / "none.json", "--json", "v.json"
    )
    assert code == 1
    assert f"REFUSED {name}.json: " in out
    assert "the signature" in out
    assert "REFUSED none.json: leaderboards/submissions/exp1/none.json does not exist." in out
    assert out.endswith("0 of 2 verified\n")
    assert [row["state"] for row in json.loads(Path("v.json").read_text())] == ["refused"] * 2


def test_a_hash_is_published_before_the_runs_and_the_seed_after_them(cli, stored_run, monkeypatch):
    monkeypatch.setenv(SEED_VARIABLE, SECRET)
    assert "was never published" in cli("board", "hidden", "exp1", "--reveal")[2]
    code, out, _ = cli("board", "hidden", "exp1")
    assert code == 0
    (path,) = Path("leaderboards/hidden").glob("exp1-*.toml")
    text = path.read_text()
    assert SECRET not in text + out
    assert "holds the hash of this seed already" in cli("board", "hidden", "exp1")[1]
    assert path.read_text() == text
    monkeypatch.setenv(SEED_VARIABLE, SECRET[::-1])
    assert cli("board", "hidden", "exp1")[0] == 0  # a second seed is a second file
    assert path.read_text() == text
    monkeypatch.setenv(SEED_VARIABLE, SECRET)
    assert "take a new seed" in cli("board", "hidden", "exp1", "--reveal")[1]
    revealed = tomllib.loads(path.read_text())
    assert revealed == {**tomllib.loads(text), "seed": SECRET}
    assert "already" in cli("board", "hidden", "exp1")[1]  # does not take the seed back
    assert tomllib.loads(path.read_text()) == revealed


def test_hidden_mistakes(refused, stored_run, monkeypatch):
    monkeypatch.delenv(SEED_VARIABLE, raising=False)
    assert f"{SEED_VARIABLE}, which is not set" in refused("board", "hidden", "exp1")
    assert f"{SEED_VARIABLE}, which is not set" in refused(
        "run", "exp1", "--model", "mean", "--hidden-seed"
    )
    monkeypatch.setenv(SEED_VARIABLE, "1234")
    sentence = refused("board", "hidden", "exp1")
    assert "has 4 characters and could be found by trying" in sentence
    assert "1234" not in sentence
    monkeypatch.setenv(SEED_VARIABLE, SECRET)
    assert "takes recorded presses, which no seed draws" in refused("board", "hidden", "surface")
    assert "was published for exp1@2" in refused("run", "exp1", "--model", "mean", "--hidden-seed")
    assert "leave one of --hidden-seed and --test reference out" in refused(
        "run", "exp1", "--model", "mean", "--hidden-seed", "--test", "reference"
    )
