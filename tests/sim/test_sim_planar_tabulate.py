"""The planar table from the finite-element run."""

from dataclasses import replace

import numpy as np
import pytest
import tabulate_pad as tabulate

from tactibench_sim.planar import mechanics as tables

pytest.importorskip("ngsolve", reason='the finite-element extra, pip install "tactibench[fem]"')


def test_a_shallow_press_gives_the_shipped_numbers():
    shipped = tables.shipped()
    delta = shipped.delta[:5]
    found = tabulate.press(tabulate.PAD, 3.0, delta, shipped.r)
    for quantity, values in found.items():
        expected = shipped.fields[quantity][0, :5]
        scale = 1e-3 * expected.max() if quantity == "force" else 1e-3
        np.testing.assert_allclose(values, expected, atol=scale)


@pytest.mark.slow
def test_the_shipped_table_is_reproduced(tmp_path):
    path = tmp_path / "planar.npz"
    told: list[str] = []
    tabulate.tabulate(path, progress=told.append)
    made, shipped = tables.read(path), tables.shipped()
    assert told == ["sphere of 3 mm"]
    assert made.parameters["pad"] == shipped.parameters["pad"]
    for quantity in tables.QUANTITIES:
        scale = 1e-3 * shipped.fields[quantity].max() if quantity == "force" else 2e-3
        np.testing.assert_allclose(made.fields[quantity], shipped.fields[quantity], atol=scale)


@pytest.mark.slow
def test_a_coarser_mesh_gives_the_same_fields():
    shipped = tables.shipped()
    delta = shipped.delta[:17]
    coarse = replace(tabulate.PAD, contact_size=0.15)
    found = tabulate.press(coarse, 3.0, delta, shipped.r)
    for quantity in ("w", "t", "w_surface", "t_surface"):
        np.testing.assert_allclose(found[quantity], shipped.fields[quantity][0, :17], atol=2e-3)
