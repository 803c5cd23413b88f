"""A protocol file never changes without a new version."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tactibench.errors import UserError
from tactibench.protocols import (
    load_protocol,
    protocol_files,
    read_protocol,
    recorded_version,
    version_of,
)
from tactibench.shipped import shipped_folder

CHANGELOG = (shipped_folder("protocols") / "CHANGELOG.md").read_text(encoding="utf-8")


def entries(text: str) -> dict[str, tuple[str, str]]:
    """``id@version`` -> hash and what follows it."""
    parts = re.split(r"^## (\S+@\d+)$", text, flags=re.MULTILINE)
    found = {}
    for label, body in zip(parts[1::2], parts[2::2], strict=True):
        assert label not in found, f"{label} is listed twice"
        match = re.match(r"\s*hash `([0-9a-f]{64})`\n(.*)", body, flags=re.DOTALL)
        assert match, f"{label} has no hash"
        found[label] = (match[1], match[2])
    return found


@pytest.mark.parametrize("name", protocol_files())
def test_the_hash_of_this_version_is_listed(name: str) -> None:
    protocol = read_protocol(protocol_files()[name])
    listed = entries(CHANGELOG)
    assert protocol.label in listed, f"add an entry for {protocol.label}, hash {protocol.hash}"
    assert listed[protocol.label][0] == protocol.hash, (
        f"{name}.toml changed: raise its version and add an entry with hash {protocol.hash}"
    )
    assert re.search(r"^- \S", listed[protocol.label][1], flags=re.MULTILINE)


def test_every_entry_is_of_a_protocol_in_its_present_version() -> None:
    present = {load_protocol(name).label for name in protocol_files()}
    assert set(entries(CHANGELOG)) == present


def test_the_present_version_is_loaded_by_its_label_and_no_other() -> None:
    present = load_protocol("stability")
    assert load_protocol(present.label) == present
    assert version_of("stability", present.hash) == present
    assert version_of("stability", "0" * 64) is None
    assert recorded_version(present.label, present.hash, "run") == present
    with pytest.raises(UserError, match=r"no 'stability@1'; .* is stability@2 \(commit e6a49ac9 "):
        load_protocol("stability@1")
    with pytest.raises(UserError, match="unknown protocol 'nothing@1'"):
        load_protocol("nothing@1")
    with pytest.raises(UserError, match=r"run answers stability@1 .* present one is stability@2 "):
        recorded_version("stability@1", "0" * 64, "run")
    with pytest.raises(UserError, match="run answers protocol 'nothing', which is not installed"):
        recorded_version("nothing@1", "0" * 64, "run")


def copied(name: str, folder: Path) -> Path:
    for path in filter(Path.is_file, shipped_folder("protocols").iterdir()):
        (folder / path.name).write_bytes(path.read_bytes())
    return folder / f"{name}.toml"


def test_the_hash_sees_comments_and_test_frames_but_not_line_ends(tmp_path: Path) -> None:
    path = copied("surface", tmp_path)
    before = read_protocol(path).hash
    assert before == read_protocol(protocol_files()["surface"]).hash
    raw = path.read_bytes()
    path.write_bytes(raw.replace(b"\n", b"\r\n"))
    assert read_protocol(path).hash == before
    path.write_bytes(raw + b"# more\n")
    assert read_protocol(path).hash != before
    path.write_bytes(raw)
    frames = tmp_path / "surface_test_frames.txt"
    lines = frames.read_text(encoding="utf-8").splitlines()
    frames.write_text("\n".join(lines[:-1]) + "\n", encoding="utf-8")
    assert read_protocol(path).hash != before
    frames.write_text("  # another comment\r\n" + "\r\n".join(lines), encoding="utf-8")
    assert read_protocol(path).hash == before
