"""Points to frames: the compiled loops over markers and pixels, without the interpreter's lock.

"Cover" is the white light of every pixel, 0 for gel and 1 for a tip. Its type (float32 for frames,
float64 for bounds) is that of all arithmetic on pixels.
"""

# One file: numba's cache on disk follows changes of the file of the function that is called.

from __future__ import annotations

import math

import numpy as np

from tactibench_sim.compiled import jit

_11, _3, _24, _40, _16 = (np.uint64(n) for n in (11, 3, 24, 40, 16))
_ONE, _LOW = np.uint64(1), np.uint64(0xFFFF)
_NEWTON = 60  # limit, never reached: all steps have one sign and converge quadratically
_STRETCH = 1024  # pixels whose noise is drawn before it is added: both stay in the fastest cache


@jit
def sfc64(state, words):  # type: ignore[no-untyped-def]
    """Fill words with the next outputs of SFC64 (Doty-Humphrey, PractRand 0.93).

    Args:
        state: (4,) uint64, which advances.
        words: (N,) uint64, filled.
    """
    a, b, c, counter = state[0], state[1], state[2], state[3]
    for k in range(words.shape[0]):
        word = a + b + counter
        counter += _ONE
        a = b ^ (b >> _11)
        b = c + (c << _3)
        c = ((c << _24) | (c >> _40)) + word
        words[k] = word
    state[0], state[1], state[2], state[3] = a, b, c, counter


@jit
def blurred_disc(radius, edge):  # type: ignore[no-untyped-def]
    """Return height h, radius r and half-width w of the profile of a blurred disc.

    A straight rim is a smoothstep, +-edge wide, where the blur is a hemisphere of radius edge:
    (1 - x^2) is its projection. The profile h smoothstep((r + w - distance) / (2 w)) has the light
    pi radius^2 of the blurred disc and its mean square distance radius^2 / 2 + 2 edge^2 / 5 from
    the middle: small discs are as wide as the blur, and faint (r = w).

    Args:
        radius: Radius of the disc, px.
        edge: Half-width of the soft edge of a large disc, px.
    """
    # For r >= w, with h = 1: light pi (r^2 + w^2 / 5), second moment pi / 2 times
    # (r^4 + 6 r^2 w^2 / 5 + 3 w^4 / 35).
    square, blur = radius * radius, edge * edge
    wide = 2.0 * blur / (1.0 + math.sqrt(max(1.0 - 4.0 * blur / (7.0 * square), 0.0)))  # w^2
    if square >= 1.2 * wide:  # r >= w
        return 1.0, math.sqrt(square - wide / 5.0), math.sqrt(wide)
    wide = 1.05 * (square / 2.0 + 0.4 * blur)
    return square / (1.2 * wide), math.sqrt(wide), math.sqrt(wide)


@jit
def splat(x, y, radius, edge, cover):  # type: ignore[no-untyped-def]
    """Add blurred discs (``blurred_disc``) to cover (H, W).

    A pixel takes the mean of four points a quarter of a pixel from its centre, which cancels the
    first harmonic of the sampling and stands for its area.

    Args:
        x: (P,) px.
        y: (P,) px.
        radius: (P,) px.
        edge: Half-width of the soft edge, px.
        cover: (H, W), to which the discs are added.
    """
    kind = cover.dtype.type
    nought, one, two, three, quarter = kind(0), kind(1), kind(2), kind(3), kind(0.25)
    height, width = cover.shape
    for p in range(x.shape[0]):
        light, rim, soft = blurred_disc(radius[p], edge)
        reach = rim + soft
        wide = reach + 0.25
        if not (-wide < x[p] < width - 1 + wide and -wide < y[p] < height - 1 + wide):
            continue
        share, per_edge = kind(light) * quarter, one / (two * kind(soft))
        left, right = max(0, math.ceil(x[p] - wide)), min(width - 1, math.floor(x[p] + wide))
        top, bottom = max(0, math.ceil(y[p] - wide)), min(height - 1, math.floor(y[p] + wide))
        first, far = kind(left - x[p]), kind(reach)
        for i in range(top, bottom + 1):
            down = kind(i - y[p])
            row = cover[i, left : right + 1]
            for half in range(2):
                at = down + quarter if half else down - quarter
                square = at * at
                for j in range(row.shape[0]):
                    across = first + kind(j)
                    before, after = across - quarter, across + quarter
                    a = (far - np.sqrt(square + before * before)) * per_edge
                    b = (far - np.sqrt(square + after * after)) * per_edge
                    a, b = min(max(a, nought), one), min(max(b, nought), one)
                    row[j] += share * (a * a * (three - two * a) + b * b * (three - two * b))


@jit
def _smooth(cover, taps, line):  # type: ignore[no-untyped-def]
    """Convolve rows, then columns, in place; the border's value continues beyond the border."""
    half = taps.shape[0] // 2
    for axis in range(2):
        lines = cover if axis == 0 else cover.T
        for i in range(lines.shape[0]):
            last = lines.shape[1] - 1
            for j in range(last + 1):
                line[j] = lines[i, j]
            for j in range(last + 1):
                total = taps[half] * line[j]
                for k in range(1, half + 1):
                    total += taps[half + k] * (line[max(j - k, 0)] + line[min(j + k, last)])
                lines[i, j] = total


@jit
def light(x, y, radius, edge, glare, gain, levels, taps, cover):  # type: ignore[no-untyped-def]
    """Fill cover (H, W) with the grey levels of one frame.

    Args:
        x: (P,) px.
        y: (P,) px.
        radius: (P,) px.
        edge: Half-width of the discs' soft edge, px.
        glare: (H, W) cover without discs.
        gain: (H, W) vignetting.
        levels: (2,) background and contrast, grey levels.
        taps: Weights of the Gaussian blur; of length 1 for no blur.
        cover: (H, W), filled.
    """
    one = cover.dtype.type(1)
    for i in range(cover.shape[0]):
        for j in range(cover.shape[1]):
            cover[i, j] = glare[i, j]
    splat(x, y, radius, edge, cover)
    for i in range(cover.shape[0]):
        for j in range(cover.shape[1]):
            cover[i, j] = min(cover[i, j], one)
    if taps.shape[0] > 1:
        _smooth(cover, taps, np.empty(cover.shape[1], cover.dtype))
    for i in range(cover.shape[0]):
        for j in range(cover.shape[1]):
            cover[i, j] = (levels[0] + levels[1] * cover[i, j]) * gain[i, j]


@jit
def expose(grey, state, shot, read, table, out):  # type: ignore[no-untyped-def]
    """Fill out (N,) uint8 with grey (N,) plus noise of variance read^2 + shot grey, clipped.

    Pixel k takes 16 bits from bit 16 (k % 4) of word k // 4 of the stream; the state advances.

    Args:
        grey: (N,) grey levels without noise.
        state: (4,) of SFC64.
        shot: Variance per grey level.
        read: Read noise, grey levels.
        table: (65536,) standard normal values.
        out: (N,) uint8, filled.
    """
    half, most, nought = np.float32(0.5), np.float32(255), np.float32(0)
    floor = np.float32(read * read)
    shot = np.float32(shot)
    words = np.empty(_STRETCH // 4, np.uint64)
    normal = np.empty(_STRETCH, np.float32)
    for start in range(0, grey.shape[0], _STRETCH):
        part, put = grey[start : start + _STRETCH], out[start : start + _STRETCH]
        sfc64(state, words)
        for k in range(words.shape[0]):
            word = words[k]
            for j in range(4):
                normal[4 * k + j] = table[np.int64(word & _LOW)]
                word >>= _16
        for k in range(part.shape[0]):
            seen = part[k] + normal[k] * np.sqrt(floor + shot * max(part[k], nought))
            put[k] = np.uint8(np.int32(min(max(seen, nought), most) + half))


@jit
def frames(  # type: ignore[no-untyped-def]
    x,
    y,
    radius,
    edge,
    glare,
    gain,
    levels,
    taps,
    tint,
    states,
    shot,
    read,
    table,
    out,
):
    """Fill out (S, H, W, C) uint8 with discs x, y, radius (S, P).

    Args:
        x: (S, P) px.
        y: (S, P) px.
        radius: (S, P) px.
        edge: Half-width of the discs' soft edge, px.
        glare: (H, W) cover without discs.
        gain: (H, W) vignetting.
        levels: (2,) background and contrast, grey levels.
        taps: Weights of the Gaussian blur; of length 1 for no blur.
        tint: (C,) light in each channel.
        states: (S, 4) of SFC64, freshly seeded.
        shot: Variance per grey level; with read 0 as well, there is no noise.
        read: Read noise, grey levels.
        table: (65536,) standard normal values.
        out: (S, H, W, C), filled.
    """
    cover = np.empty(glare.shape, np.float32)
    tinted = np.empty(cover.size * tint.shape[0], np.float32)
    stir = np.empty(12, np.uint64)
    for s in range(x.shape[0]):
        light(x[s], y[s], radius[s], edge, glare, gain, levels, taps, cover)
        flat = cover.ravel()
        for c in range(tint.shape[0]):
            for k in range(flat.shape[0]):
                tinted[k * tint.shape[0] + c] = flat[k] * tint[c]
        sfc64(states[s], stir)
        expose(tinted, states[s], shot, read, table, out[s].ravel())


@jit
def clean(x, y, radius, edge, glare, gain, levels, taps, out):  # type: ignore[no-untyped-def]
    """Fill out (S, H, W) with grey levels without noise, not rounded.

    The other arguments are those of ``frames``.
    """
    for s in range(x.shape[0]):
        light(x[s], y[s], radius[s], edge, glare, gain, levels, taps, out[s])


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
def project(  # type: ignore[no-untyped-def]
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
