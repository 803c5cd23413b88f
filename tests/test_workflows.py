"""What pull requests of strangers run: pinned actions, no secrets, data apart from code."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import textwrap
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / ".github" / "workflows"
GUARDED = ("verify.yml", "verify-comment.yml")
ALL = tuple(sorted(path.name for path in FOLDER.glob("*.y*ml")))

pytestmark = pytest.mark.skipif(not FOLDER.is_dir(), reason="no workflows: not a checkout")


def text(name: str) -> str:
    lines = (FOLDER / name).read_text(encoding="utf-8").splitlines()
    return "\n".join(line for line in lines if not line.lstrip().startswith("#"))


@pytest.mark.parametrize("name", ALL)
def test_actions_are_pinned_and_secrets_absent(name: str) -> None:
    for used in re.findall(r"uses: (\S+)", text(name)):
        assert re.fullmatch(r"actions/[a-z-]+@[0-9a-f]{40}", used), used
    assert "secrets." not in text(name)
    assert "pull_request_target" not in text(name)
    assert text(name).count("runs-on:") == text(name).count("timeout-minutes:"), "no job for ever"
    assert text(name).count("actions/checkout@") == text(name).count("persist-credentials: false")


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


def test_pages_are_made_by_the_merge_and_a_request_needs_none() -> None:
    pages = text("pages.yml")
    assert "- run: tactibench board write\n" in pages
    assert re.search(r"^on:\n  push:\n    branches: \[main\]\n", pages, re.MULTILINE)
    assert "pull_request" not in pages
    assert "board check" not in (ROOT / "scripts" / "check").read_text(encoding="utf-8")


@pytest.fixture
def request_of(tmp_path: Path):
    """Files that a pull request adds -> what the script prints, with a tactibench that echoes."""
    repository = tmp_path / "submitted"
    folder = repository / "leaderboards" / "submissions"
    fake = tmp_path / "bin"
    fake.mkdir()
    (fake / "tactibench").write_text(
        '#!/bin/sh\necho "asked: $*"\ncase "$*" in *slow*) exec sleep 60;; *bad*) exit 1;; esac\n'
    )
    (fake / "tactibench").chmod(0o755)

    def git(*arguments: str) -> str:
        who = ["-c", "user.name=n", "-c", "user.email=e", "-c", "commit.gpgsign=false"]
        command = ["git", "-C", str(repository), *who, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    def made(*names: str, before: tuple[str, ...] = ()) -> tuple[int, str]:
        folder.mkdir(parents=True)
        (repository / "start").write_text("")
        for name in before:  # those that are not named again are removed
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text("before")
        git("init", "-q")
        git("add", "-A")
        git("commit", "-qm", "base")
        base = git("rev-parse", "HEAD")
        for name in before:
            (folder / name).unlink()
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
            env={"PATH": f"{fake}:/usr/bin:/bin", "LIMIT": "1"},
        )
        return done.returncode, done.stdout.replace(f"{folder}/", "")

    return made


def test_a_record_and_its_answers_are_verified_once(request_of) -> None:
    assert request_of("exp1/a.json", "exp1/a.npz", "exp2/b.npz") == (
        0,
        "asked: board verify exp1/a.json\nasked: board verify exp2/b.json\n",
    )


def test_a_file_that_takes_too_long_is_refused_and_the_next_one_is_verified(request_of) -> None:
    code, out = request_of("exp1/bad.json", "exp1/slow.json", "exp2/b.json")
    assert code == 1
    assert out.splitlines() == [
        "asked: board verify exp1/bad.json",
        "asked: board verify exp1/slow.json",
        "REFUSED leaderboards/submissions/exp1/slow.json: it was not verified within 1 s.",
        "asked: board verify exp2/b.json",
    ]


@pytest.mark.parametrize("name", ["exp1/a.py", "exp1/$(id).json", "a.json"])
def test_other_files_are_refused(request_of, name: str) -> None:
    code, out = request_of(name)
    assert code == 1
    assert out.startswith("REFUSED leaderboards/submissions/")
    assert "asked" not in out


def test_what_was_committed_before_is_said_to_be_changed_or_removed(request_of) -> None:
    before = ("exp1/a.json", "exp1/a.npz", "exp1/b.npz")
    code, out = request_of("exp1/a.json", "exp1/a.npz", "exp1/c.json", before=before)
    place = "leaderboards/submissions/exp1"
    assert (code, out.splitlines()) == (
        0,
        [
            f"NOTE the request changes {place}/a.json, which was committed before.",
            f"NOTE the request changes {place}/a.npz, which was committed before.",
            f"NOTE the request removes {place}/b.npz, which was committed before.",
            "asked: board verify exp1/a.json",
            "asked: board verify exp1/c.json",
        ],
    )


def test_no_submission_is_no_error(request_of) -> None:
    assert request_of() == (0, "no submission was added or changed\n")


def test_too_many_are_refused(request_of) -> None:
    code, out = request_of(*(f"exp1/r{k}.json" for k in range(21)))
    assert (code, out) == (1, "REFUSED: 21 submissions in one pull request; send at most 20.\n")


GH = """#!/bin/sh
case "$*" in
  *pulls/7/files*) cat "$ANSWERS/files" ;;
  *pulls/7) echo '{"changed_files": '"$COUNT"'}' ;;
  *"/pulls "*) echo '[{"number": 7, "head": {"sha": "abc"}}]' ;;
  *runs/5/artifacts*)
    echo '{"artifacts": [{"name": "verdict", "id": 3, "size_in_bytes": '"$SIZE"'}]}' ;;
  *artifacts/3/zip*) cat "$ANSWERS/verdict.zip" ;;
  "pr comment 7 "*) cat comment.md ;;
  *) echo "unexpected: $*" >&2; exit 9 ;;
esac
"""


@pytest.fixture
def comment(tmp_path: Path):
    """Changed files and archive of a request -> exit code and comment, with a gh that answers."""
    for program in ("jq", "unzip"):
        if shutil.which(program) is None:
            pytest.skip(f"no {program} here")
    text = (FOLDER / "verify-comment.yml").read_text(encoding="utf-8")
    script = textwrap.dedent(text.split("        run: |\n", 1)[1])
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "gh").write_text(GH)
    (tmp_path / "bin" / "gh").chmod(0o755)

    def made(
        files: list[dict[str, str]],
        members: dict[str, bytes] | None = None,
        *,
        count: int = 1,
        size: int = 500,
        workflow: str = ".github/workflows/verify.yml",
    ) -> tuple[int, str]:
        (tmp_path / "files").write_text(json.dumps(files))
        with zipfile.ZipFile(tmp_path / "verdict.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in (members or {}).items():
                archive.writestr(name, content)
        work = tmp_path / "work"
        work.mkdir(exist_ok=True)
        done = subprocess.run(
            ["bash", "-c", script],
            capture_output=True,
            text=True,
            check=False,
            cwd=work,
            env={
                "PATH": f"{tmp_path / 'bin'}:/usr/bin:/bin",
                "ANSWERS": str(tmp_path),
                "COUNT": str(count),
                "SIZE": str(size),
                "GH_REPO": "lab/tactibench",
                "RUN": "5",
                "WORKFLOW": workflow,
                "SHA": "abc",
                "OWNER": "stranger",
                "BRANCH": "mine",
            },
        )
        assert {path.name for path in work.rglob("*")} <= {
            *("changed.txt", "comment.md", "verdict.txt", "verdict.zip")
        }
        return done.returncode, done.stdout + done.stderr

    return made


DATA = [{"filename": "leaderboards/submissions/exp1/a.json"}]


def test_a_verdict_is_shown_as_plain_text(comment) -> None:
    said = b"VERIFIED a\n```\n@everyone \x1b[2J \xe2\x80\xae<b>"
    code, out = comment(DATA, {"verdict.txt": said})
    assert code == 0
    head, body = out.split("```text\n")
    assert head == "### tactibench board verify\n\n"
    assert body == "VERIFIED a\n\n@everyone [2J <b>\n```\n"


@pytest.mark.parametrize(
    "file",
    [
        {"filename": ".github/workflows/verify.yml"},
        {"filename": "a.yml", "previous_filename": ".github/workflows/verify.yml"},
    ],
)
def test_a_request_that_changes_a_workflow_has_no_verdict(comment, file) -> None:
    code, out = comment([*DATA, file], {"verdict.txt": b"VERIFIED all\n"}, count=2)
    assert code == 0
    assert "VERIFIED" not in out
    assert "its verdict is not shown, because its own workflow may have written it" in out
    assert "VERIFIED" not in comment(DATA, {"verdict.txt": b"VERIFIED all\n"}, count=3001)[1]


def test_another_workflow_of_that_name_is_refused(comment) -> None:
    workflow = ".github/workflows/mine.yml"
    code, out = comment(DATA, {"verdict.txt": b"VERIFIED\n"}, workflow=workflow)
    assert (code, out) == (1, "the workflow is not verify.yml\n")


@pytest.mark.parametrize(
    "members",
    [
        {"../../escaped.txt": b"x", "verdict.txt": b"small\n"},
        {"verdict.txt": b"small\n" + b"\n" * 50_000_000},
    ],
    ids=["a path", "a bomb"],
)
def test_a_hostile_archive_is_read_within_bounds(comment, members) -> None:
    code, out = comment(DATA, members)
    assert code == 0
    assert len(out) < 70_000


def test_an_archive_that_is_too_large_is_not_fetched(comment) -> None:
    assert comment(DATA, {"verdict.txt": b"x"}, size=2_000_000) == (0, "nothing was printed\n")
