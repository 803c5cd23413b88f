"""Protocol fine: what its numbers promise about tips, spacings, gate, grid and encoder."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tactibench import Contacts
from tactibench.geometry import tip_positions, true_contacts
from tactibench.plugins import PluginHost
from tactibench.protocols import SceneSet, draw_scenes, load_protocol, protocol_files, read_protocol

SPEC = load_protocol("fine").spec
TESTED, TRAINED = (set(SPEC.draw(name).distances_mm) for name in ("pairs", "duals-train"))


@cache
def drawn_by(name: str) -> SceneSet:
    return draw_scenes(SPEC, name)


def truths(drawn: SceneSet) -> list[Contacts]:
    return [true_contacts(scene, SPEC.workspace.dome_radius_mm) for scene in drawn.scenes]


@pytest.mark.parametrize("name", sorted(draw.name for draw in SPEC.draws))
def test_every_tip_touches_inside_the_ranges(name: str) -> None:
    for scene, truth in zip(drawn_by(name).scenes, truths(drawn_by(name)), strict=True):
        assert scene.indenter.radius == 1.0
        assert len(truth) == len(scene.indenter.offsets)
        assert np.abs(truth.xy).max() <= 6.4 + 1e-9
        assert truth.depth.min() >= 0.4 - 1e-8
        assert truth.depth.max() <= 1.5 + 1e-8


def test_a_hundred_pairs_at_every_spacing_and_none_is_both_trained_and_tested() -> None:
    apart = [
        float(np.linalg.norm(np.subtract(*tip_positions(scene)[:, :2])))
        for scene in drawn_by("pairs").scenes
    ]
    values, counts = np.unique(np.round(apart, 6), return_counts=True)
    assert values == pytest.approx(np.arange(2.0, 6.6, 0.5))
    assert (counts == 100).all()
    assert not TESTED & TRAINED
    assert min(TESTED | TRAINED) >= 2 * SPEC.draw("pairs").radius_mm  # spheres do not overlap


def test_no_prediction_is_inside_the_gate_of_both_tips() -> None:
    assert 2 * SPEC.test.gate_mm <= min(TESTED)


def test_it_shares_no_press_with_another_protocol() -> None:
    """Streams of one data seed: equal ones would give the same random numbers."""
    streams = {draw.stream for draw in SPEC.draws}
    for name, path in protocol_files().items():
        other = read_protocol(path).spec
        if name != "fine":
            assert not streams & {draw.stream for draw in other.draws}
            assert not streams & {family.stream for family in other.families}


def test_the_default_encoder_reads_every_pair_as_two_on_the_grid() -> None:
    """Exact maps of the nearest tips; the outermost lie two widths of a peak inside the grid."""
    encoder = PluginHost().encoders[SPEC.defaults.encoder].build()
    grid = SPEC.grid.grid()
    pairs = truths(drawn_by("pairs"))
    for true in [*pairs[-10:], *pairs[:10]]:
        found = encoder.decode(encoder.encode(true, grid), grid)
        assert len(found) == 2
        apart = np.linalg.norm(found.xy[:, None] - true.xy[None], axis=2)
        assert apart.min(axis=0).max() < 0.02
        order = apart.argmin(axis=1)
        assert np.abs(found.depth - true.depth[order]).max() < 0.02
