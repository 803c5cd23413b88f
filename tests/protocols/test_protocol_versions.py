"""A protocol file never changes without a new version."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tactibench.errors import UserError
from tactibench.protocols import (
    archived_files,
    load_protocol,
    name_of,
    protocol_files,
    protocol_versions,
    read_protocol,
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


def test_every_entry_is_of_a_protocol_and_none_of_a_later_version() -> None:
    last = {
        name: max(one.spec.version for one in protocol_versions(name)) for name in protocol_files()
    }
    for label in entries(CHANGELOG):
        name, _, version = label.partition("@")
        assert int(version) <= last[name]


@pytest.mark.parametrize("label", archived_files())
def test_an_archived_version_is_the_one_that_was_listed(label: str) -> None:
    protocol = load_protocol(label)
    assert (protocol.label, protocol.name, protocol.archived) == (label, label, True)
    assert entries(CHANGELOG)[label][0] == protocol.hash
    present = load_protocol(protocol.spec.id)
    assert protocol.spec.version < present.spec.version
    assert version_of(protocol.spec.id, protocol.hash) == protocol
    assert name_of(protocol.spec.id, protocol.hash) == label
    assert name_of(protocol.spec.id, present.hash) == protocol.spec.id
    assert name_of(protocol.spec.id, "0" * 64) == protocol.spec.id
    assert protocol in protocol_versions(protocol.spec.id)


def test_every_earlier_version_is_kept() -> None:
    kept = {one.label for name in protocol_files() for one in protocol_versions(name)}
    assert kept == set(entries(CHANGELOG))


def test_a_version_is_loaded_by_its_label() -> None:
    present = load_protocol("stability")
    assert load_protocol(present.label) == present
    assert present.name == "stability"
    with pytest.raises(UserError, match=r"no 'stability@9'.*stability@2, stability@1\.$"):
        load_protocol("stability@9")
    with pytest.raises(UserError, match="unknown protocol 'nothing@1'"):
        load_protocol("nothing@1")
    assert protocol_versions("nothing") == ()
    assert version_of("stability", "0" * 64) is None


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
