"""Protocols of one's own: found in a folder, never mistaken for those that ship."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tactibench import Pose, Scene, UserError
from tactibench.contacts import Indenter
from tactibench.frames import could_be_drawn, describe_draw
from tactibench.geometry import tip_positions
from tactibench.protocols import (
    board_spec,
    draw_scenes,
    fits,
    load_protocol,
    protocol_files,
    protocol_titles,
)

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "protocols"
EXP2 = protocol_files()["exp2"]


@pytest.fixture
def own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(EXAMPLES))


@pytest.mark.usefixtures("own")
def test_an_own_protocol_is_known_by_name_with_its_board() -> None:
    assert load_protocol("row").spec.id == "row"
    assert protocol_titles()["row"] == (1, "three tips in a row")
    ranking = board_spec("row").ranking
    assert ranking is not None
    assert ranking.metric == "gospa1_mm"


def test_without_the_folder_it_is_unknown() -> None:
    with pytest.raises(UserError, match="unknown protocol 'row'"):
        load_protocol("row")


def test_a_changed_file_needs_an_id_of_its_own(tmp_path: Path) -> None:
    text = EXP2.read_text(encoding="utf-8")
    copy = tmp_path / "copy.toml"
    copy.write_text(text, encoding="utf-8")
    assert load_protocol(str(copy)).hash == load_protocol("exp2").hash
    copy.write_text(text.replace("per_distance = 100", "per_distance = 10"), encoding="utf-8")
    with pytest.raises(UserError, match=r"not the 'exp2' that ships.*'my-exp2'"):
        load_protocol(str(copy))
    copy.write_text(text.replace('id = "exp2"', 'id = "copy"'), encoding="utf-8")
    assert load_protocol(str(copy)).label == "copy@3"


def test_a_shipped_protocol_is_never_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "exp2.toml").write_text(EXP2.read_text().replace("= 100", "= 10"))
    (tmp_path / "other.toml").write_text(EXP2.read_text().replace('id = "exp2"', 'id = "own"'))
    monkeypatch.setenv("TACTIBENCH_PROTOCOLS", str(tmp_path))
    assert load_protocol("exp2").path == EXP2
    with pytest.raises(UserError, match=r"call it own\.toml"):
        load_protocol("other")


@pytest.mark.usefixtures("own")
def test_a_holder_presses_as_it_is_given() -> None:
    spec = load_protocol("row").spec
    draw = spec.draw("row")
    assert draw.tips == 3
    scenes = draw_scenes(spec, "row").scenes
    assert len(scenes) == 200
    assert all(fits(scene, spec.workspace) for scene in scenes)
    assert all(could_be_drawn(scene, draw, spec.workspace) for scene in scenes)
    tips = tip_positions(scenes[0])[:, :2]
    np.testing.assert_allclose(np.linalg.norm(np.diff(tips, axis=0), axis=1), 5.5)
    moved = Indenter(3.0, ((-5.5, 0.0, 0.0), (0.1, 0.0, 0.0), (5.5, 0.0, 0.0)), "tips")
    assert not could_be_drawn(Scene(moved, Pose(depth=2.0)), draw, spec.workspace)
    assert describe_draw(draw) == "3 tips on the holder 'row' of radius 3 mm"
