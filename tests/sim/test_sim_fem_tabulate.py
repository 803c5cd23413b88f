"""scripts/fem/tabulate_dome.py: any radius, all or nothing."""

import math

import numpy as np
import pytest
import tabulate_dome as maker

from tactibench_sim import fem
from tactibench_sim.mechanics import tables as table_file

pytest.importorskip("ngsolve", reason="needs the extra `fem`")


def invented(dome, radius, delta, polar):
    """Columns that tell their radius, at no cost."""
    size = 99.0 if math.isinf(radius) else radius
    field = np.outer(delta, np.cos(polar)) / size
    columns = dict.fromkeys(("w", "t", "omega", "w_outer", "t_outer"), field)
    return {**columns, "force": delta * size}


def command(*arguments):
    maker.main([str(argument) for argument in arguments])


@pytest.mark.parametrize(
    ("asked", "made"),
    [
        ((), [3.0, math.inf]),
        ((4,), [4.0]),
        ((2.5, 4, "inf"), [2.5, 4.0, math.inf]),
        ((4, 4.0), [4.0]),
    ],
)
def test_radii_asked_for_are_radii_read(tmp_path, monkeypatch, capsys, asked, made):
    monkeypatch.setattr(maker, "columns", invented)
    out = tmp_path / "dome.npz"
    command(out, *(part for radius in asked for part in ("--radius", radius)))
    tables = table_file.read(out)
    assert tables.digest in capsys.readouterr().out
    assert sorted(tables.by_radius) == made
    for radius, one in tables.by_radius.items():
        told = invented(None, radius, one.delta, one.polar)
        assert one.radius == radius
        for name, values in told.items():
            assert one.fields[name] == pytest.approx(values, rel=1e-6)


def test_a_run_that_does_not_converge_leaves_no_file(tmp_path, monkeypatch):
    def columns(dome, radius, delta, polar):
        if radius == 5:
            raise fem.NotConvergedError("the finite-element run did not converge beyond 4.085")
        return invented(dome, radius, delta, polar)

    monkeypatch.setattr(maker, "columns", columns)
    with pytest.raises(SystemExit, match="no file was written"):
        command(tmp_path / "dome.npz", "--radius", 4, "--radius", 5)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("wrong", ["0", "-3", "nan", "three"])
@pytest.mark.parametrize("option", ["--radius", "--skin", "--stiffness-ratio"])
def test_an_impossible_number_is_refused(tmp_path, capsys, option, wrong):
    with pytest.raises(SystemExit):
        command(tmp_path / "dome.npz", option, wrong)
    assert option in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_sphere_between_two_others(tmp_path):
    out = tmp_path / "four.npz"
    command(out, "--radius", 4)
    four, shipped = table_file.read(out).by_radius[4.0], table_file.shipped().by_radius
    force = four.fields["force"][1:]
    assert (force > shipped[3.0].fields["force"][1:]).all()
    assert (force < shipped[math.inf].fields["force"][1:]).all()
    assert four.fields["w_outer"][:, 0] == pytest.approx(four.delta, abs=0.004)
