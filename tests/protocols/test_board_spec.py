"""A protocol declares its ranking and its tables in a file beside it."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tactibench import UserError
from tactibench.metrics import check_metrics, find_metric
from tactibench.protocols import (
    BoardSpec,
    board_spec,
    load_protocol,
    protocol_files,
    read_board_spec,
    read_protocol,
)

PROTOCOLS = sorted(protocol_files())
TABLE = '[[blocks]]\ntitle = "Error"\ncolumns = [{}]\n'
COLUMN = '{ metric = "mae_mm", head = "MAE", decimals = 3 }'


def written(folder: Path, text: str) -> Path:
    (folder / "mine.board.toml").write_text(text, encoding="utf-8")
    return folder / "mine.toml"


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_every_protocol_ranks_and_shows_metrics_that_there_are(protocol: str) -> None:
    spec = board_spec(protocol)
    assert spec.ranking is not None
    assert find_metric(spec.ranking.metric).better == "lower"
    check_metrics(load_protocol(protocol))


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_note_on_unseen_sensors_stands_where_their_columns_always_do(protocol: str) -> None:
    blocks = [block for block in board_spec(protocol).blocks if not block.apart]
    assert not [block.title for block in blocks if "Unseen" in block.note]


def test_a_misspelt_metric_of_a_board_is_told_before_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = protocol_files()["exp1"].read_text(encoding="utf-8")
    (tmp_path / "mine.toml").write_text(text.replace('"exp1"', '"mine"', 1), encoding="utf-8")
    written(tmp_path, '[[run_tables]]\ntitle = "T"\nmetrics = { mae_mn = 3 }\n')
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(tmp_path))
    with pytest.raises(UserError, match=r"'mine' shows 'mae_mn'.* did you mean 'mae_mm'\?"):
        check_metrics(load_protocol("mine"))


def test_a_board_file_leaves_the_hash_of_its_protocol_alone(tmp_path: Path) -> None:
    path = protocol_files()["exp1"]
    for source in path.parent.glob("*.t*"):
        if not source.name.endswith(".board.toml"):
            shutil.copy(source, tmp_path)
    assert read_protocol(tmp_path / path.name).hash == read_protocol(path).hash


def test_a_protocol_without_a_board_file_has_nothing_special(tmp_path: Path) -> None:
    assert read_board_spec(tmp_path / "mine.toml") == BoardSpec()
    assert board_spec("mine") == BoardSpec()


def test_a_column_with_groups_stands_for_one_a_group(tmp_path: Path) -> None:
    column = '{ metric = "mae_mm", groups = ["x", "y"], head = "MAE {group}, mm", decimals = 4 }'
    (block,) = read_board_spec(written(tmp_path, TABLE.format(column))).blocks
    assert [(one.group, one.head) for one in block.columns] == [
        ("x", "MAE x, mm"),
        ("y", "MAE y, mm"),
    ]


def test_common_tables_follow_those_of_the_protocol(tmp_path: Path) -> None:
    text = 'common = ["bound"]\n' + TABLE.format(COLUMN)
    titles = [block.title for block in read_board_spec(written(tmp_path, text)).blocks]
    assert titles == ["Error", "RMSE over the Cramer-Rao bound"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[rankings]", "unknown key 'rankings'; did you mean 'ranking'"),
        ('[ranking]\nmetric = "mae_mm"\n', "the key 'ranking.decimals' is missing"),
        ('common = ["bounds"]\n', "holds 'bounds'; did you mean 'bound'"),
        (TABLE.format(""), "key 'blocks.1.columns' is"),
        (TABLE.format('{ metric = "mae_mm", groups = 3, head = "x", decimals = 3 }'), "groups"),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(UserError, match=r"mine\.board\.toml") as raised:
        read_board_spec(written(tmp_path, text))
    assert words in str(raised.value)
