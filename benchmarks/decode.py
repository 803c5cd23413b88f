"""Measure speed and error of the encoders and their decoders: ``python benchmarks/decode.py``.

Speed: one map with three contacts, and many maps at once, against
``skimage.feature.peak_local_max``, which returns cells, in the same run. "cpu" is the time that the
thread itself ran, which other work on the machine changes less.
Error: rms position error of the best contact in cells at white noise 0.02, 2 to 6 mm deep; then
errors in mm on maps without noise, and with noise as in the maps of networks (smooth, correlated
over two cells, stronger where there is heat, and some white noise).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.ndimage import gaussian_filter
from skimage.feature import peak_local_max

from tactibench import Contacts, Encoder, Grid
from tactibench.run import time_calls
from tactibench_heatmaps import HeatAndDepth, HertzGaussian, Offsets

GRID = Grid.centred(64, 0.4)
MAPS = 1500
ENCODERS: dict[str, Encoder] = {
    "hertz maximum": HertzGaussian(decoder="maximum"),
    "hertz least-squares": HertzGaussian(decoder="least-squares"),
    "hertz wide, free width": HertzGaussian(width="free"),
    "hertz wide": HertzGaussian(),
    "depth maximum": HeatAndDepth(decoder="maximum"),
    "depth least-squares": HeatAndDepth(),
    "offset": Offsets(),
}
NOISES = {"clean": (0.0, 0.0), "network": (0.015, 0.003), "rough": (0.03, 0.01)}


def triples(rng: np.random.Generator, count: int) -> list[Contacts]:
    """Return frames of three contacts 8 mm apart, as the triple indenter makes them."""
    turn = rng.uniform(0, 2 * np.pi, (count, 1)) + np.arange(3) * 2 * np.pi / 3
    xy = 8 / np.sqrt(3) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    xy += rng.uniform(-1.5, 1.5, (count, 1, 2))
    return [Contacts.truth(p, d) for p, d in zip(xy, rng.uniform(0.5, 6, (count, 3)), strict=True)]


def singles(rng: np.random.Generator, count: int, shallowest: float = 0.5) -> list[Contacts]:
    xy, depth = rng.uniform(-6.4, 6.4, (count, 1, 2)), rng.uniform(shallowest, 6, (count, 1))
    return [Contacts.truth(p, d) for p, d in zip(xy, depth, strict=True)]


def pairs(rng: np.random.Generator, count: int) -> list[Contacts]:
    """Return frames of two contacts 6.5 to 8 mm apart, of any depths."""
    turn, distance = rng.uniform(0, 2 * np.pi, count), rng.uniform(6.5, 8, count)
    half = 0.5 * distance[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    centre, depth = rng.uniform(-2, 2, (count, 2)), rng.uniform(0.5, 6, (count, 2))
    return [Contacts.truth([c - h, c + h], d) for c, h, d in zip(centre, half, depth, strict=True)]


def noisy(rng: np.random.Generator, maps: np.ndarray, smooth: float, white: float) -> np.ndarray:
    field = gaussian_filter(rng.standard_normal(maps.shape), (0, 0, 2, 2))
    field *= smooth / field.std()
    field += white * rng.standard_normal(maps.shape)
    return np.asarray(np.clip(maps + (0.2 + maps) * field, 0, 1), dtype=np.float32)


def errors(found: list[Contacts], truth: list[Contacts]) -> tuple[float, float, float]:
    """Return mean position and depth error, mm, of frames with the right count, and their share."""
    position, depth = [], []
    for answer, true in zip(found, truth, strict=True):
        if len(answer) == len(true):
            away = np.linalg.norm(answer.xy[:, None] - true.xy, axis=-1)
            nearest = away.argmin(axis=0)
            position.append(away.min(axis=0).mean())
            depth.append(np.abs(answer.depth[nearest] - true.depth).mean())
    return float(np.mean(position)), float(np.mean(depth)), len(position) / len(truth)


def by_skimage(maps: np.ndarray) -> Contacts:
    """Return the peaks of scikit-image, with the threshold and the least distance of hertz."""
    cells = peak_local_max(
        maps[0], min_distance=7, threshold_abs=0.25 / 6, exclude_border=False, num_peaks=6
    )
    heat = maps[0][cells[:, 0], cells[:, 1]]
    return Contacts(GRID.xy(*cells.T), 6.0 * heat, np.minimum(heat, 1.0))


def by_argmax(maps: np.ndarray) -> Contacts:
    """Return the highest cell as a contact."""
    row, column = divmod(int(maps[0].argmax()), GRID.shape[1])
    heat = maps[0].max(keepdims=True).ravel()
    return Contacts(GRID.xy([row], [column]), 6.0 * heat, np.minimum(heat, 1.0))


def best_seconds(work: Callable[[], object], clock: Callable[[], float], rounds: int = 3) -> float:
    best = float("inf")
    for _ in range(rounds):
        start = clock()
        work()
        best = min(best, clock() - start)
    return best


def timed(name: str, decode: Callable[[np.ndarray], Contacts], maps: np.ndarray) -> float:
    """Print the times of decoding one map, and return the thread's own time, us."""
    stage = ("decode", lambda one: decode(one[0]))
    sample = time_calls({name: [stage]}, list(maps[:300]), threads=1, calls=1000)[name]
    row = sample.rows("single")[-1]
    cpu = best_seconds(lambda: [decode(one) for one in maps[:300]], time.thread_time) / 300
    print(
        f"{name:21s} one map p50 {1e3 * row['p50_ms']:5.0f} us, p90 {1e3 * row['p90_ms']:5.0f} us,"
        f" cpu {1e6 * cpu:5.0f} us",
        end="",
    )
    return 1e6 * cpu


def show_speed(rng: np.random.Generator) -> None:
    contacts = triples(rng, MAPS)
    heat = noisy(rng, HertzGaussian().encode_batch(contacts, GRID), 0.015, 0.003)
    slow = timed("skimage, hertz", by_skimage, heat)
    print()
    for name, encoder in ENCODERS.items():
        maps = noisy(rng, encoder.encode_batch(contacts, GRID), 0.015, 0.003)
        quick = timed(name, partial(encoder.decode, grid=GRID), maps)
        batch = partial(encoder.decode_batch, maps, GRID)
        wall = MAPS / best_seconds(batch, time.perf_counter)
        cpu = MAPS / best_seconds(batch, time.thread_time)
        encoded = MAPS / best_seconds(
            partial(encoder.encode_batch, contacts, GRID), time.thread_time, rounds=1
        )
        print(
            f"; batch {wall:7,.0f} maps/s, cpu {cpu:7,.0f}; encode, cpu {encoded:7,.0f};"
            f" skimage / this, cpu: {slow / quick:.1f}"
        )


def rms_cells(found: list[Contacts], truth: list[Contacts]) -> float:
    away = [
        f.xy[0] - t.xy[0] if len(f) else [np.nan] * 2 for f, t in zip(found, truth, strict=True)
    ]
    return float(np.sqrt(np.mean(np.square(away)))) / GRID.pitch


def show_white_noise(rng: np.random.Generator) -> None:
    truth = singles(rng, 500, shallowest=2.0)
    for name, encoder in ENCODERS.items():
        maps = encoder.encode_batch(truth, GRID)
        maps += 0.02 * rng.standard_normal(maps.shape, dtype=np.float32)
        rms = rms_cells(encoder.decode_batch(maps, GRID), truth)
        line = f"white noise 0.02: {name:21s} rms {rms:.3f} cells"
        for other, decode in (("argmax", by_argmax), ("skimage", by_skimage)):
            theirs = rms_cells([decode(noisy_maps) for noisy_maps in maps], truth)
            line += f"; {other} {theirs:.3f}, {theirs / rms:.1f} times as much"
        print(line)


def show_errors(rng: np.random.Generator) -> None:
    for kind, scenes in {"single": singles, "pair": pairs}.items():
        truth = scenes(rng, 300)
        for noise, (smooth, white) in NOISES.items():
            for name, encoder in ENCODERS.items():
                drawn = noisy(rng, encoder.encode_batch(truth, GRID), smooth, white)
                position, depth, share = errors(encoder.decode_batch(drawn, GRID), truth)
                print(
                    f"{kind:6s} {noise:7s} {name:21s} position {position:.4f} mm,"
                    f" depth {depth:.4f} mm, right count {share:.3f}"
                )


if __name__ == "__main__":
    seeds = np.random.SeedSequence(1).spawn(3)
    show_speed(np.random.default_rng(seeds[0]))
    show_white_noise(np.random.default_rng(seeds[1]))
    show_errors(np.random.default_rng(seeds[2]))
