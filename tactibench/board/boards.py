"""All pages of a board, as text, and whether the committed ones say the same."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tactibench.board.labels import whole
from tactibench.board.page import page
from tactibench.board.published import load_published
from tactibench.board.submissions import (
    all_press_errors,
    committed_protocols,
    read_submissions,
)
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols.loader import protocol_files, read_protocol
from tactibench.records.files import atomic
from tactibench.records.record import Record
from tactibench.shipped import shipped_folder


@dataclass(frozen=True)
class Page:
    """A generated page. records: those that it was made from; on_curve: those of fewer presses."""

    path: Path
    text: str
    records: int
    on_curve: int

    @property
    def current(self) -> bool:
        """Whether the file holds this very text."""
        try:
            return self.path.read_text(encoding="utf-8") == self.text
        except (OSError, UnicodeDecodeError):
            return False

    def write(self) -> None:
        with atomic(self.path) as stream:
            stream.write(self.text.encode())


def pages(board: Path) -> list[Page]:
    """The page of every protocol, from the committed records. Raises UserError."""
    check_folder(board)
    files = protocol_files()
    for name in committed_protocols(board):
        if name not in files:
            raise UserError(
                f"{board} holds records of a protocol {name!r}; {did_you_mean(name, files)}"
            )
    return [_page(board, name) for name in files]


def records_of(board: Path, protocol: str) -> list[Record]:
    """Committed records of a protocol. Raises UserError for an unknown one, or no board."""
    files = protocol_files()
    if protocol not in files:
        raise UserError(f"unknown protocol {protocol!r}; {did_you_mean(protocol, files)}")
    check_folder(board)
    return read_submissions(board, protocol)


def check_folder(board: Path) -> None:
    """Raise UserError where there is no board."""
    if not board.is_dir():
        raise UserError(
            f"there is no board in {board}; call this in a checkout of tactibench, or name its "
            "folder with --board DIR."
        )


def _page(board: Path, name: str) -> Page:
    protocol = read_protocol(protocol_files()[name])
    records = read_submissions(board, name)
    own = board / "published"
    folder = own if own.is_dir() else shipped_folder("published")
    published = load_published(protocol.keys.published.tables, folder)
    text = page(protocol, records, published, all_press_errors(board, records))
    return Page(board / f"{name}.md", text, len(records), len(records) - len(whole(records)))
