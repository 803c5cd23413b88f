"""`tactibench sim tabulate`: any radius, all or nothing."""

import math

import numpy as np
import pytest
from click.testing import CliRunner

from tactibench import UserError
from tactibench_sim import fem, table
from tactibench_sim import tabulate as maker
from tactibench_sim.command import sim

pytest.importorskip("ngsolve", reason="needs the extra `fem`")


def invented(dome, radius, delta, polar):
    """Columns that tell their radius, at no cost."""
    size = 99.0 if math.isinf(radius) else radius
    field = np.outer(delta, np.cos(polar)) / size
    columns = dict.fromkeys(("w", "t", "omega", "w_outer", "t_outer"), field)
    return {**columns, "force": delta * size}


def command(*arguments):
    return CliRunner().invoke(sim, ["tabulate", *map(str, arguments)])


@pytest.mark.parametrize(
    ("asked", "made"),
    [
        ((), [3.0, math.inf]),
        ((4,), [4.0]),
        ((2.5, 4, "inf"), [2.5, 4.0, math.inf]),
        ((4, 4.0), [4.0]),
    ],
)
def test_radii_asked_for_are_radii_read(tmp_path, monkeypatch, asked, made):
    monkeypatch.setattr(maker, "columns", invented)
    out = tmp_path / "dome.npz"
    result = command(out, *(part for radius in asked for part in ("--radius", radius)))
    assert result.exit_code == 0, result.output
    tables = table.read(out)
    assert tables.digest in result.output
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
    result = command(tmp_path / "dome.npz", "--radius", 4, "--radius", 5)
    assert isinstance(result.exception, UserError)
    assert "no table was written" in str(result.exception)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("wrong", ["0", "-3", "nan", "three"])
@pytest.mark.parametrize("option", ["--radius", "--skin", "--stiffness-ratio"])
def test_an_impossible_number_is_refused(tmp_path, option, wrong):
    result = command(tmp_path / "dome.npz", option, wrong)
    assert result.exit_code == 2
    assert option in result.output
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_sphere_between_two_others(tmp_path):
    out = tmp_path / "four.npz"
    assert command(out, "--radius", 4).exit_code == 0
    four, shipped = table.read(out).by_radius[4.0], table.shipped().by_radius
    force = four.fields["force"][1:]
    assert (force > shipped[3.0].fields["force"][1:]).all()
    assert (force < shipped[math.inf].fields["force"][1:]).all()
    assert four.fields["w_outer"][:, 0] == pytest.approx(four.delta, abs=0.004)
