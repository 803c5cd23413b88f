"""``tactibench board``: adding, writing, checking; one sentence for every mistake."""

from __future__ import annotations

import csv
import json
import tomllib
from pathlib import Path

import pytest
from few_presses import few_presses

from tactibench.protocols.loader import SEED_VARIABLE

SECRET = "c0ffee" * 8


def test_runs_are_added_written_and_checked(cli, stored_run):
    names = [stored_run(seed=0), stored_run(seed=1)]
    code, out, _ = cli("board", "add", *names)
    assert code == 0
    assert f"added leaderboards/submissions/exp1/{names[0]}.json" in out
    assert "leaderboards/exp1.md: 2 runs; written" in out
    text = Path("leaderboards/exp1.md").read_text(encoding="utf-8")
    assert "| n/a | unet | 0.0500<br><sub>0.0450 – 0.0550</sub> |" in text
    assert Path("leaderboards/images/exp1.png").stat().st_size > 10_000
    assert "Smallest GOSPA of 1 model: unet, 0.0500 mm." in Path(
        "leaderboards/README.md"
    ).read_text(encoding="utf-8")
    assert cli("board", "check")[0] == 0
    assert "exp1.md: 2 runs; unchanged" in cli("board", "write")[1]


def test_a_changed_page_fails_the_check_with_what_to_do(cli, stored_run):
    cli("board", "add", stored_run())
    Path("leaderboards/exp1.md").write_text("better numbers")
    code, _, err = cli("board", "check")
    assert code == 1
    assert err == (
        "leaderboards/exp1.md is not what the committed records give; run "
        "`tactibench board write` and commit it.\n"
    )
    assert Path("leaderboards/exp1.md").read_text() == "better numbers"
    cli("board", "write")
    Path("leaderboards/exp1.md").unlink()
    assert "leaderboards/exp1.md is not" in cli("board", "check")[2]
    Path("leaderboards").rename("lab")
    assert (
        "run `tactibench board write --board lab` and" in cli("board", "check", "--board", "lab")[2]
    )


def test_a_pattern_takes_whole_runs_and_the_newest_of_a_seed(cli, stored_run):
    stored_run(seed=0, name="exp1-old", created="2026-01-01T00:00:00+00:00")
    stored_run(seed=0, name="exp1-new", created="2026-01-02T00:00:00+00:00", error=0.01)
    stored_run(seed=1, name="exp1-quick", partial=True)
    code, out, _ = cli("board", "add", "exp1-*")
    assert code == 0
    assert "in place of exp1-old.json, the same row and seed" in out
    files = sorted(path.name for path in Path("leaderboards/submissions/exp1").iterdir())
    assert files == ["exp1-new.json", "exp1-new.npz"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["add", "exp1-part"], "is a partial run"),
        (["add", "nothing-*"], "holds no complete run called like 'nothing-*'"),
        (["add", "exp1-par*"], "but 1 partial ones"),
        (["add", "exp1-pard"], "did you mean 'exp1-part'"),
        (["export"], "name a file with --json or --csv"),
        (
            ["write", "--board", "nowhere"],
            "no folder nowhere; name another with --board DIR, or begin one: `mkdir",
        ),
    ],
)
def test_mistakes(refused, stored_run, options, words):
    stored_run(partial=True, name="exp1-part")
    assert words in refused("board", *options)
    assert not list(Path("leaderboards").iterdir())


def test_the_figures_are_written_as_csv(cli, stored_run):
    more = (("gospa_depth_mm", "=1+2", 0.3),)
    cli("board", "add", stored_run(model="a_b", error=0.0625, metrics=more))
    assert cli("board", "export", "--csv", "rows.csv")[0] == 0
    with Path("rows.csv").open(newline="") as stream:
        row, other = (row for row in csv.DictReader(stream) if row["metric"] == "gospa_depth_mm")
    assert (row["value"], row["unit"], row["model"]) == ("0.0625", "mm", "a_b")
    assert row["best_rank"] == row["worst_rank"] == ""
    assert (row["seeds"], other["group"]) == ("0", "'=1+2")  # no list, and no formula


def test_the_ranked_rows_are_shown(cli, refused, stored_run):
    assert "has no ranked rows of exp1; `tactibench board add RUN`" in refused(
        "board", "show", "exp1"
    )
    cli("board", "add", stored_run(error=0.05), stored_run(model="cnn", error=0.07))
    code, out, _ = cli("board", "show", "exp1")
    assert code == 0
    assert out.index("  unet ") < out.index("  cnn ")
    assert "0.0500 [0.0450, 0.0550]" in out
    assert out.endswith("page: leaderboards/exp1.md\n")
    full = cli("board", "show", "exp1", "--full")[1]
    assert "Speed and cost" in full
    assert "Speed and cost" not in out


@pytest.mark.long
def test_a_record_is_reproduced_by_a_command(cli, tmp_path, monkeypatch):
    files = few_presses(tmp_path / "few")
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(files["exp1"].parent))
    monkeypatch.setenv("TACTIBENCH_CACHE", str(tmp_path / "cache"))
    Path("leaderboards").mkdir()
    ran = cli("run", "few-exp1", "--model", "nearest", "--presses", "20")
    assert ran[0] == 0, ran
    assert cli("board", "submit", *(path.name for path in Path("runs").glob("few-*")))[0] == 0
    (path,) = Path("leaderboards/submissions/few-exp1").glob("*.json")
    code, out, _ = cli("board", "reproduce", str(path), "--by", "a lab", "--json", "rows.json")
    assert code == 0
    assert out.startswith(f"REPRODUCED {path.name}\n")
    assert "metrics within tolerance, on the same test frames" in out
    assert f"noted in {path}: reproduced by a lab" in out
    assert {row["within"] for row in json.loads(Path("rows.json").read_text())} == {True}
    verified = cli("board", "verify", str(path))
    assert verified[0] == 0, verified


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
    run = ("run", "exp1", "--model", "mean", "--hidden-seed")
    assert f"{SEED_VARIABLE}, which is not set" in refused("board", "hidden", "exp1")
    assert f"{SEED_VARIABLE}, which is not set" in refused(*run)
    monkeypatch.setenv(SEED_VARIABLE, "1234")
    sentence = refused("board", "hidden", "exp1")
    assert "has 4 characters and could be found by trying" in sentence
    assert "1234" not in sentence
    monkeypatch.setenv(SEED_VARIABLE, SECRET)
    assert "takes recorded presses, which no seed draws" in refused("board", "hidden", "surface")
    assert "was published for exp1@3" in refused(*run)
    both = refused(*run, "--test", "reference")
    assert "leave one of --hidden-seed and --test reference out" in both
