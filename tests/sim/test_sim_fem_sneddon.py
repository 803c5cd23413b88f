"""A large flat block against Sneddon's solution of a rigid sphere on a half-space.

Sneddon's theory is linear: small strain, vertical traction, contact judged at undeformed places. A
twin of the product's problem with these three replaced must give his force at every depth; the
finite-strain problem must tend to it as the contact becomes small.
"""

import math

import numpy as np
import pad_press
import pytest
from axisymmetric import AxisymmetricPress
from pad_press import Pad
from scipy.optimize import brentq

RADIUS = 3.0
BLOCK = Pad(
    thickness=400, skin=0, stiffness_ratio=1, width=800, gel_size=40, penalty=1000, contact_size=0.1
)


def sneddon(depth, radius=RADIUS):
    """(contact radius, force / E) at nu = 1/2."""

    def travel(a):
        return a / 2 * math.log((radius + a) / (radius - a))

    a = brentq(lambda a: travel(a) - depth, 1e-9, radius * (1 - 1e-12))
    return a, 4 / 3 * ((a**2 + radius**2) / 2 * math.log((radius + a) / (radius - a)) - a * radius)


class Linear(AxisymmetricPress):
    """Sneddon's assumptions in place of finite strain."""

    def stored(self, young, u, pressure):
        import ngsolve as ngs

        strain, hoop = ngs.Sym(ngs.Grad(u)), u[0] / ngs.x
        volume = ngs.Trace(strain) + hoop
        return young / 3 * (ngs.InnerProduct(strain, strain) + hoop**2) + pressure * volume

    def inside(self, u):
        import ngsolve as ngs

        square = self.radius**2 - ngs.x**2
        surface = self.radius - ngs.sqrt(ngs.IfPos(square, square, 0.0))
        height = ngs.y + u[1] - (self.top - self.depth)
        return ngs.IfPos(square, height - surface, -1.0)

    def steepness(self, u):
        return 1.0


def test_sneddon_tends_to_hertz():
    a, force = sneddon(1e-4)
    assert force == pytest.approx(16 / 9 * math.sqrt(RADIUS) * 1e-4**1.5, rel=1e-4)
    assert a == pytest.approx(math.sqrt(RADIUS * 1e-4), rel=1e-4)


@pytest.mark.slow
def test_linear_twin_gives_sneddons_force(monkeypatch):
    pytest.importorskip("ngsolve", reason="needs the extra `fem`")
    monkeypatch.setattr(pad_press, "AxisymmetricPress", Linear)
    depths = np.array([0.1, 0.25, 0.5, 1.0, 1.5, 2.0])
    forces = [p.force for p in pad_press.press_pad(BLOCK, RADIUS, depths, np.zeros(1))]
    assert forces == pytest.approx([sneddon(d)[1] for d in depths], rel=0.01)
    hertz = 16 / 9 * math.sqrt(RADIUS) * 2**1.5
    assert abs(forces[-1] / hertz - 1) > 0.05  # the check can tell the two


@pytest.mark.slow
def test_finite_strain_tends_to_sneddon_for_small_contacts():
    """What is missing is of first order in a / R and grows from nothing."""
    pytest.importorskip("ngsolve", reason="needs the extra `fem`")
    depths = np.array([0.05, 0.1, 0.25, 0.5, 1.0, 2.0])
    forces = np.array([p.force for p in pad_press.press_pad(BLOCK, RADIUS, depths, np.zeros(1))])
    radii, told = np.array([sneddon(d) for d in depths]).T
    missing = 1 - forces / told
    assert abs(missing[0]) < 0.01
    _, offset = np.polyfit(radii / RADIUS, missing, 1)
    assert abs(offset) < 0.005
    assert (np.diff(missing) > 0).all()
