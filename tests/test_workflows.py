"""What pull requests of strangers run: pinned actions, no secrets, data apart from code."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / ".github" / "workflows"
GUARDED = ("verify.yml", "verify-comment.yml")

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="no workflows: not a checkout")


def text(name: str) -> str:
    lines = (FOLDER / name).read_text(encoding="utf-8").splitlines()
    return "\n".join(line for line in lines if not line.lstrip().startswith("#"))


@pytest.mark.parametrize("name", GUARDED)
def test_actions_are_pinned_and_secrets_absent(name: str) -> None:
    for used in re.findall(r"uses: (\S+)", text(name)):
        assert re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40}", used), used
    assert "secrets." not in text(name)
    assert "pull_request_target" not in text(name)


@pytest.mark.parametrize("name", GUARDED)
def test_no_event_text_stands_in_a_script(name: str) -> None:
    """What a stranger named (a branch, a title) reaches a shell as a variable only."""
    scripts = re.findall(r"run: (\|\n(?:\s{10,}.*\n?)+|.*)", text(name))
    assert scripts
    assert not [script for script in scripts if "${{" in script]


def test_the_verifier_reads_and_the_commenter_runs_nothing_of_the_request() -> None:
    verify, comment = text("verify.yml"), text("verify-comment.yml")
    assert re.search(r"^permissions:\n  contents: read\n\n", verify, re.MULTILINE)
    assert "write" not in verify
    assert verify.count("persist-credentials: false") == verify.count("actions/checkout@") == 2
    assert re.findall(r"working-directory: (\S+)", verify) == ["trusted"]
    assert "checkout" not in comment
    assert "permissions: {}" in comment


@pytest.fixture
def request_of(tmp_path: Path):
    """Files that a pull request adds -> what the script prints, with a tactibench that echoes."""
    repository = tmp_path / "submitted"
    folder = repository / "leaderboards" / "submissions"
    fake = tmp_path / "bin"
    fake.mkdir()
    (fake / "tactibench").write_text('#!/bin/sh\necho "asked: $*"\n')
    (fake / "tactibench").chmod(0o755)

    def git(*arguments: str) -> str:
        who = ["-c", "user.name=n", "-c", "user.email=e", "-c", "commit.gpgsign=false"]
        command = ["git", "-C", str(repository), *who, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    def made(*names: str) -> tuple[int, str]:
        folder.mkdir(parents=True)
        (repository / "start").write_text("")
        git("init", "-q")
        git("add", "-A")
        git("commit", "-qm", "base")
        base = git("rev-parse", "HEAD")
        for name in names:
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(name)
        git("add", "-A")
        git("commit", "-qm", "head", "--allow-empty")
        script = ["bash", str(ROOT / "scripts" / "verify_changed"), str(repository), base]
        done = subprocess.run(
            [*script, git("rev-parse", "HEAD"), str(tmp_path / "out")],
            capture_output=True,
            text=True,
            check=False,
            env={"PATH": f"{fake}:/usr/bin:/bin"},
        )
        return done.returncode, done.stdout.replace(f"{folder}/", "")

    return made


def test_a_record_and_its_answers_are_verified_once(request_of) -> None:
    assert request_of("exp1/a.json", "exp1/a.npz", "exp2/b.npz") == (
        0,
        "asked: board verify exp1/a.json exp2/b.json\n",
    )


@pytest.mark.parametrize(
    "name", ["exp1/a.py", "exp1/a b.json", "exp1/$(id).json", "a.json", "exp1/--json.json"]
)
def test_other_files_are_refused(request_of, name: str) -> None:
    code, out = request_of(name)
    assert code == 1
    assert out.startswith("REFUSED leaderboards/submissions/")
    assert "asked" not in out


def test_no_submission_is_no_error(request_of) -> None:
    assert request_of() == (0, "no submission was added or changed\n")


def test_too_many_are_refused(request_of) -> None:
    code, out = request_of(*(f"exp1/r{k}.json" for k in range(21)))
    assert (code, out) == (1, "REFUSED: 21 submissions in one pull request; send at most 20.\n")
