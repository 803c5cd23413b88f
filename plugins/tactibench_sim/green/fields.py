"""Displacements and their derivatives from forces at points, by the kernel's piecewise cubics."""

from __future__ import annotations

from tactibench_sim.compiled import jit
from tactibench_sim.green.lookup import Array, Index, chord_of, value

INNER, OUTER = 2, 0


@jit
def even(c: Array, x: float, start: float) -> tuple[float, float]:
    """Return a cubic at start + x and its derivative by cos(theta) = 1 - q^2 / 2: -f'(q) / q."""
    f = ((c[3] * x + c[2]) * x + c[1]) * x + c[0]
    if start == 0.0:  # c[1] is zero there: divided by hand, so that nothing divides by zero
        return f, -(2 * c[2] + 3 * c[3] * x)
    return f, -((3 * c[3] * x + 2 * c[2]) * x + c[1]) / (start + x)


@jit
def displace(
    sources: Array,
    weight: Array,
    table: Index,
    tables: Array,
    step: float,
    at: Array,
    layer: int,
    u: Array,
    slope: Array,
) -> None:
    """Add the effect of sources (N, 3) at directions ``at`` (P, 3) to u (P, 3) and its slope, mm.

    weight: (N,), table: (N,) index into tables (T, C, 4, 4). layer: INNER or OUTER. slope @ v is
    the derivative of u when the direction moves along the unit tangent v, mm per rad.
    u = sum over m of -w b + T (b c - m) with c = b . m and T = t / sin(theta).
    """
    cells = tables.shape[1]
    for p in range(len(at)):
        b0, b1, b2 = at[p, 0], at[p, 1], at[p, 2]
        down = away = 0.0
        m0 = m1 = m2 = g0 = g1 = g2 = 0.0
        xx = xy = xz = yy = yz = zz = 0.0
        for k in range(len(sources)):
            chord = chord_of(at[p], sources[k])
            cell = int(chord / step)
            if cell >= cells or weight[k] == 0.0:
                continue
            start = cell * step
            row = tables[table[k], cell]
            w, dw = even(row[layer], chord - start, start)
            t, dt = even(row[layer + 1], chord - start, start)
            w, dw, t, dt = weight[k] * w, weight[k] * dw, weight[k] * t, weight[k] * dt
            x, y, z = sources[k, 0], sources[k, 1], sources[k, 2]
            c = 1 - chord * chord / 2
            down += w
            away += t * c
            m0 += t * x
            m1 += t * y
            m2 += t * z
            g = dt * c + t - dw
            g0 += g * x
            g1 += g * y
            g2 += g * z
            xx += dt * x * x
            xy += dt * x * y
            xz += dt * x * z
            yy += dt * y * y
            yz += dt * y * z
            zz += dt * z * z
        r = away - down
        u[p, 0] += r * b0 - m0
        u[p, 1] += r * b1 - m1
        u[p, 2] += r * b2 - m2
        slope[p, 0, 0] += r + b0 * g0 - xx
        slope[p, 0, 1] += b0 * g1 - xy
        slope[p, 0, 2] += b0 * g2 - xz
        slope[p, 1, 0] += b1 * g0 - xy
        slope[p, 1, 1] += r + b1 * g1 - yy
        slope[p, 1, 2] += b1 * g2 - yz
        slope[p, 2, 0] += b2 * g0 - xz
        slope[p, 2, 1] += b2 * g1 - yz
        slope[p, 2, 2] += r + b2 * g2 - zz


@jit
def inward(
    sources: Array, weight: Array, table: Index, tables: Array, step: float, at: Array, w: Array
) -> None:
    """Add to w (Q,) the inward displacement of the outer skin at directions ``at`` (Q, 3), mm."""
    cells = tables.shape[1]
    for p in range(len(at)):
        for k in range(len(sources)):
            chord = chord_of(at[p], sources[k])
            cell = int(chord / step)
            if cell < cells and weight[k] != 0.0:
                w[p] += weight[k] * value(tables[table[k]], OUTER, chord, step)
