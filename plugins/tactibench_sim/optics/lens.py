"""Projection of points in the gel: rays from the camera through air, window and gel."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tactibench import UserError
from tactibench_sim.compiled import jit
from tactibench_sim.optics.camera import Optics

Array = npt.NDArray[np.float64]
_NEWTON = 60  # limit, never reached: all steps have one sign and converge quadratically


@jit
def slope_per_mm(rho, air, window, gel, window_index, gel_index):  # type: ignore[no-untyped-def]
    """Return q = tan(angle in air) / rho of the ray that reaches a point rho mm off the axis.

    A ray of slope s in air has slope s / sqrt(n^2 + (n^2 - 1) s^2) in a medium of index n (Snell),
    so that with thicknesses a, t, g of air, window, gel

        q (a + t / sqrt(n_w^2 + (n_w^2 - 1) s^2) + g / sqrt(n_g^2 + (n_g^2 - 1) s^2)) = 1, s = q rho

    and the ray hits the window a s from the axis. The left side rises and is concave in q: Newton
    from the paraxial q comes from below and converges for every point.

    Args:
        rho: Distance of the point from the axis, mm.
        air: Thickness of the air, mm.
        window: Thickness of the window, mm.
        gel: Depth of the point in the gel, mm.
        window_index: Refractive index of the window.
        gel_index: Refractive index of the gel.
    """
    window_square, gel_square = window_index * window_index, gel_index * gel_index
    q = 1.0 / (air + window / window_index + gel / gel_index)
    for _ in range(_NEWTON):
        square = q * q * rho * rho
        u = window_square + (window_square - 1.0) * square
        v = gel_square + (gel_square - 1.0) * square
        tu, gv = window / math.sqrt(u), gel / math.sqrt(v)
        missing = 1.0 - q * (air + tu + gv)
        step = missing / (air + tu * window_square / u + gv * gel_square / v)
        q += step
        if not step > 1e-9 * q:  # the next error is its square
            break
    return q


@jit
def _project(  # type: ignore[no-untyped-def]
    points,
    lift,
    air,
    window,
    near,
    window_index,
    gel_index,
    fisheye,
    scale,
    middle,
    turn,
    marker,
    out,
):
    """Fill out (3, N) with x, y, radius, px, of points (N, 3); NaN for those not in the gel."""
    cosine, sine = math.cos(turn), math.sin(turn)
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        gel = points[k, 2] + lift - near
        if not gel > 0.0:
            out[:, k] = np.nan
            continue
        rho = math.sqrt(x * x + y * y)
        q = slope_per_mm(rho, air, window, gel, window_index, gel_index)
        s = q * rho
        if fisheye and s > 0.0:
            q *= math.atan(s) / s
        px = scale * q
        out[0, k] = middle[0] + px * (cosine * x - sine * y)
        out[1, k] = middle[1] + px * (sine * x + cosine * y)
        out[2, k] = px * marker


def project(optics: Optics, points: Array, lift: float = 0.0) -> tuple[Array, Array, Array]:
    """Return x, y and radius of markers in the frame, px, each of shape (...).

    A marker is seen as a disc: its radius times the transverse magnification at its place, which
    without refraction is 1 / depth.

    Args:
        optics: The camera.
        points: (..., 3) places of the markers, mm.
        lift: Added to z of the points, mm; the sum is z in the camera coordinates of ``Optics``.

    Raises:
        UserError: A marker is not inside the gel.
    """
    middle = (optics.size - 1) / 2
    axis = (middle + optics.size * optics.principal_x, middle + optics.size * optics.principal_y)
    flat = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    out = np.empty((3, len(flat)))
    _project(
        flat,
        lift,
        optics.air_mm,
        optics.window_mm,
        optics.air_mm + optics.window_mm,
        optics.window_index,
        optics.gel_index,
        optics.lens == "fisheye",
        optics.focal * optics.size,
        axis,
        math.radians(optics.roll_deg),
        optics.marker_radius_mm,
        out,
    )
    if not np.isfinite(out).all():
        raise UserError(
            f"a marker is not in the gel, which begins {optics.air_mm + optics.window_mm:g} mm "
            "from the camera; move the window towards the camera (a longer gel_length) or press "
            "less deep."
        )
    x, y, radius = out.reshape(3, *points.shape[:-1])
    return x, y, radius
