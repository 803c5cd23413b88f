"""The dome once more with scikit-fem: other mesh, other elements, derivatives by hand.

Neo-Hookean, incompressible, axisymmetric; P2 displacement and a P1 pressure of each material;
frictionless contact by penalty. It shares with the product the mechanics only.
"""

import math

import numpy as np
import pytest
from dome_press import press
from scipy.sparse import bmat
from skfem import Basis, BilinearForm, FacetBasis, LinearForm, MeshTri, condense, solve
from skfem.element import ElementTriP1, ElementTriP2, ElementVector

from tactibench_sim.fem import Dome

DOME, RADIUS, PENALTY, DEPTHS = Dome(), 3.0, 100.0, 0.08 * np.arange(1, 6)
VECTOR, SCALAR = ElementVector(ElementTriP2()), ElementTriP1()


def quarter_disc():
    """A polar grid of triangles, fine at the apex; those without area, at the centre, go."""
    radial = [19 * (1 - np.linspace(1, 0, 16) ** 1.5), np.linspace(19, 20, 6)[1:]]
    polar = [np.arange(20) * 0.005, np.geomspace(0.1, math.pi / 2, 32)]
    grid = MeshTri.init_tensor(np.hstack(radial), np.hstack(polar))
    r, angle = grid.p
    corners = grid.t.copy()
    corners[r[corners] < 1e-9] = np.flatnonzero(r < 1e-9)[0]
    corners = corners[:, (corners != np.roll(corners, 1, axis=0)).all(axis=0)]
    used, renamed = np.unique(corners, return_inverse=True)
    points = r[used] * np.stack([np.sin(angle[used]), np.cos(angle[used])])
    return MeshTri(points, renamed.reshape(corners.shape))


def gradient(u, x):
    """(3, 3, ...) displacement gradient in (radial, axial, hoop) directions."""
    full = np.zeros((3, 3, *x[0].shape))
    full[:2, :2], full[2, 2] = u.grad, u[0] / x[0]
    return full


def places(basis):
    """(2, ...) integration points."""
    return np.array(basis.global_coordinates())


def dot(a, b):
    """Product of vectors or tensors at every integration point."""
    a, b = np.asarray(a), np.asarray(b)
    return (a * b).sum(axis=tuple(range(a.ndim - 2)))


class Layer:
    """One material: stress P = mu (F - F^-T) + p J F^-T and the constraint J = 1."""

    def __init__(self, mesh, elements, young):
        self.u = Basis(mesh, VECTOR, intorder=5, elements=elements)
        self.p = Basis(mesh, SCALAR, intorder=5, elements=elements)
        self.shear = young / 3
        self.unused = np.setdiff1d(np.arange(self.p.N), mesh.t[:, elements])

    def assemble(self, u, p):
        """Residuals of balance and volume, their derivatives by (u, u) and (p, u)."""
        mu, x = self.shear, places(self.u)
        f = gradient(self.u.interpolate(u), x) + np.eye(3)[:, :, None, None]
        g = np.moveaxis(np.linalg.inv(np.moveaxis(f, (0, 1), (-2, -1))), (-2, -1), (1, 0))  # F^-T
        j = np.linalg.det(np.moveaxis(f, (0, 1), (-2, -1)))
        pj = self.p.interpolate(p) * j

        def stiffness(u, v, w):
            h = gradient(u, w.x)
            turned = np.einsum("ik...,lk...,lj...->ij...", g, h, g, optimize=True)
            change = mu * (h + turned) + pj * (dot(g, h) * g - turned)
            return dot(change, gradient(v, w.x)) * w.x[0]

        def balance(v, w):
            return dot(mu * (f - g) + pj * g, gradient(v, w.x)) * w.x[0]

        def coupling(u, q, w):
            return j * dot(g, gradient(u, w.x)) * q * w.x[0]

        volume = LinearForm(lambda q, w: (j - 1) * q * w.x[0]).assemble(self.p)
        change = BilinearForm(stiffness).assemble(self.u)
        coupled = BilinearForm(coupling).assemble(self.u, self.p)
        return LinearForm(balance).assemble(self.u), volume, change, coupled


def contact(basis, u, depth):
    """Residual, tangent and force of the sphere on the outer skin."""
    x = places(basis)
    at = x + np.asarray(basis.interpolate(u))
    at[1] -= 20 + RADIUS - depth
    distance = np.hypot(*at)
    n, inside = at / distance, np.maximum(RADIUS - distance, 0.0)

    def stiffness(u, v, w):
        along = dot(n, u) * dot(n, v)
        turned = inside / distance * (dot(u, v) - along)
        return PENALTY * ((inside > 0) * along - turned) * w.x[0]

    return (
        LinearForm(lambda v, w: -PENALTY * inside * dot(n, v) * w.x[0]).assemble(basis),
        BilinearForm(stiffness).assemble(basis),
        -2 * math.pi * PENALTY * (inside * n[1] * x[0] * basis.dx).sum(),
    )


@pytest.mark.slow
def test_scikit_fem_gives_the_same_force_and_pin_displacement():
    pytest.importorskip("ngsolve", reason="needs the extra `fem`")
    mesh = quarter_disc()
    in_skin = np.hypot(*mesh.p[:, mesh.t].mean(axis=1)) > 19
    skin, gel = (
        Layer(mesh, np.flatnonzero(chosen), DOME.moduli[name])
        for chosen, name in ((in_skin, "skin"), (~in_skin, "gel"))
    )
    outer = mesh.facets_satisfying(lambda x: np.hypot(*x) > 19.95, boundaries_only=True)
    surface = FacetBasis(mesh, VECTOR, facets=outer, intorder=6)
    ends = np.cumsum([skin.u.N, skin.p.N, gel.p.N])
    base, axis = (skin.u.get_dofs(lambda x, i=i: x[i] < 1e-9) for i in (1, 0))
    held = [base.all(), axis.all("u^1"), ends[0] + skin.unused, ends[1] + gel.unused]
    free = np.setdiff1d(np.arange(ends[-1]), np.concatenate(held))

    def newton(state, depth):
        for _ in range(25):
            u, p, q = np.split(state, ends[:-1])
            one, two, push = skin.assemble(u, p), gel.assemble(u, q), contact(surface, u, depth)
            residual = np.concatenate([one[0] + two[0] + push[0], one[1], two[1]])
            corner, b, c = one[2] + two[2] + push[1], one[3], two[3]
            tangent = bmat([[corner, b.T, c.T], [b, None, None], [c, None, None]]).tocsr()
            move = solve(*condense(tangent, -residual, I=free))
            largest = abs(move[: ends[0]]).max()
            state = state + min(1.0, 0.2 / max(largest, 1e-12)) * move
            if largest < 1e-7:
                return state, push[2]
        pytest.fail(f"the second implementation did not converge at {depth} mm")

    before = state = np.zeros(ends[-1])
    forces = []
    for depth in DEPTHS:  # equal steps: start from the straight line through the last two states
        before, (state, force) = state, newton(2 * state - before, depth)
        forces.append(force)
    pins = np.flatnonzero(abs(np.hypot(*mesh.p) - 19) < 1e-9)
    polar, (ux, uy) = np.arctan2(*mesh.p[:, pins]), state[skin.u.nodal_dofs[:, pins]]
    sine, cosine = np.sin(polar), np.cos(polar)
    profiles = list(press(DOME, RADIUS, DEPTHS, polar))
    assert forces == pytest.approx([p.force for p in profiles], rel=0.01)
    moved = [-ux * sine - uy * cosine, ux * cosine - uy * sine]
    assert np.array(moved) == pytest.approx(profiles[-1].inner, abs=0.005)
