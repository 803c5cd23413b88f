"""The folder of the leaderboards and its committed records."""

from __future__ import annotations

from pathlib import Path

from tactibench.board.submissions import read_submissions
from tactibench.errors import UserError, did_you_mean
from tactibench.protocols.loader import protocol_files
from tactibench.records.record import Record


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
