"""How contacts of one press share the load: amplitudes of single-contact fields.

The field of a press starts from sum_i a_i T(angle to n_i; s_i) with T the tabulated single-contact
field. Tier ``superpose``: a_i = 1, s_i = delta_i. Tier ``coupled``: a_i = e_i / s_i with effective
depths e_i >= 0 such that every tip still reaches its depth or stands clear,

    e_i >= 0,   g_i = sum_j a_j w(angle(n_i, n_j); s_j) - delta_i >= 0,   e_i g_i = 0,

and s_i = max(delta_i, sum_j e_j same(n_i, n_j)) the depth whose shape tip i presses into the skin;
``same`` is 1 for tips at one place and 0 from 1 mm on. So two coincident tips are one
(a_1 + a_2 = 1), a tip that lies in another's dimple carries nothing, and one beside
another's bulge carries more.
"""

from __future__ import annotations

import numpy as np

from tactibench_sim.dome_kernels import Array


def superpose(delta: Array) -> tuple[Array, Array]:
    """(a, s), each (S, K)."""
    depth = np.maximum(delta, 0.0)
    return (depth > 0).astype(np.float64), depth
