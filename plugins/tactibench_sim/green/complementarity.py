"""Complementarity of many nodes: f >= 0, A f - d >= 0, f (A f - d) = 0 for a symmetric positive A.

Block principal pivoting (Judice and Pires, Computers & Operations Research 21 (1994) 587-596):
exchange all nodes that violate; after three rounds without progress only the last of them, which
ends for every positive definite A. It starts from a guess and reaches the one solution from any.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tactibench_sim.compiled import jit
from tactibench_sim.green.lookup import Array

Mask = npt.NDArray[np.bool_]
ROUNDS = 500
"""Changes of the active set after which a scene counts as not solved."""


@jit
def factor(a: Array) -> bool:
    """Factor A = U^T U in the upper triangle, in place; False where A is not positive."""
    n = a.shape[0]
    for k in range(n):
        if not a[k, k] > 0.0:
            return False
        root = math.sqrt(a[k, k])
        for j in range(k, n):
            a[k, j] /= root
        for i in range(k + 1, n):
            times = a[k, i]
            for j in range(i, n):  # along a row: the compiler vectorises it
                a[i, j] -= times * a[k, j]
    return True


@jit
def substitute(upper: Array, x: Array) -> None:
    """Solve U^T U x = x in place."""
    n = upper.shape[0]
    for i in range(n):
        x[i] /= upper[i, i]
        for k in range(i + 1, n):
            x[k] -= upper[i, k] * x[i]
    for i in range(n - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, n):
            total -= upper[i, k] * x[k]
        x[i] = total / upper[i, i]


@jit
def solve(a: Array, d: Array, active: Mask) -> tuple[Array, bool]:
    """Return (n,) forces and whether they solve it; ``active`` (n,) is the guess, then the set."""
    n = len(d)
    force, gap = np.zeros(n), np.empty(n)
    fewest, patience = n + 1, 3
    for _ in range(ROUNDS):
        index = np.flatnonzero(active)
        m = len(index)
        force[:] = 0.0
        if m:
            part, x = np.empty((m, m)), np.empty(m)
            for i in range(m):
                x[i] = d[index[i]]
                for j in range(i, m):
                    part[i, j] = a[index[i], index[j]]
            if not factor(part):
                return force, False
            substitute(part, x)
            for i in range(m):
                force[index[i]] = x[i]
        wrong, last = 0, -1
        for i in range(n):
            if active[i]:
                bad = force[i] < 0.0
            else:
                total = -d[i]
                for k in range(m):
                    total += a[i, index[k]] * force[index[k]]
                gap[i] = total
                bad = total < -1e-12
            if bad:
                wrong += 1
                last = i
        if wrong == 0:
            return force, True
        if wrong < fewest:
            fewest, patience = wrong, 3
        elif patience > 0:
            patience -= 1
        else:
            active[last] = not active[last]
            continue
        for i in range(n):
            if active[i]:
                if force[i] < 0.0:
                    active[i] = False
            elif gap[i] < -1e-12:
                active[i] = True
    return force, False
