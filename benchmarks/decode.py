"""Speed and error of the heatmap decoders: ``python benchmarks/decode.py``.

Speed: one map with three contacts, and many. Error: maps without noise, and with noise such as
networks draw (smooth, correlated over two cells, stronger where there is heat, and some white).
"""

from __future__ import annotations

import time

import numpy as np
from scipy.ndimage import gaussian_filter

from tactibench import Contacts, Grid
from tactibench.timing.latency import time_single
from tactibench.timing.rows import speed_rows
from tactibench_heatmaps.hertz import HertzGaussian

GRID = Grid.centred(64, 0.4)
MAPS = 4000
DECODERS = {
    "maximum": HertzGaussian(decoder="maximum"),
    "least-squares 7": HertzGaussian(window=7),
    "least-squares 11": HertzGaussian(),
    "least-squares 15": HertzGaussian(window=15),
    "kernel width 11": HertzGaussian(width="kernel"),
}


def triples(rng: np.random.Generator, count: int) -> list[Contacts]:
    """Three contacts 8 mm apart, as the triple indenter makes them."""
    turn = rng.uniform(0, 2 * np.pi, (count, 1)) + np.arange(3) * 2 * np.pi / 3
    xy = 8 / np.sqrt(3) * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    xy += rng.uniform(-1.5, 1.5, (count, 1, 2))
    return [Contacts.truth(p, d) for p, d in zip(xy, rng.uniform(0.5, 6, (count, 3)), strict=True)]


def singles(rng: np.random.Generator, count: int) -> list[Contacts]:
    xy, depth = rng.uniform(-6.4, 6.4, (count, 1, 2)), rng.uniform(0.5, 6, (count, 1))
    return [Contacts.truth(p, d) for p, d in zip(xy, depth, strict=True)]


def pairs(rng: np.random.Generator, count: int) -> list[Contacts]:
    """Two contacts 6.5 to 8 mm apart, of any depths."""
    turn, distance = rng.uniform(0, 2 * np.pi, count), rng.uniform(6.5, 8, count)
    half = 0.5 * distance[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    centre, depth = rng.uniform(-2, 2, (count, 2)), rng.uniform(0.5, 6, (count, 2))
    return [Contacts.truth([c - h, c + h], d) for c, h, d in zip(centre, half, depth, strict=True)]


def noisy(rng: np.random.Generator, maps: np.ndarray, smooth: float, white: float) -> np.ndarray:
    field = gaussian_filter(rng.standard_normal(maps.shape), (0, 0, 2, 2))
    field *= smooth / field.std()
    field += white * rng.standard_normal(maps.shape)
    return np.clip(maps + (0.2 + maps) * field, 0, 1).astype(np.float32)


def errors(found: list[Contacts], truth: list[Contacts]) -> tuple[float, float, float]:
    """Mean position and depth error in mm over frames with the right count, and their share."""
    position, depth = [], []
    for one, true in zip(found, truth, strict=True):
        if len(one) == len(true):
            away = np.linalg.norm(one.xy[:, None] - true.xy, axis=-1)
            nearest = away.argmin(axis=0)
            position.append(away.min(axis=0).mean())
            depth.append(np.abs(one.depth[nearest] - true.depth).mean())
    return float(np.mean(position)), float(np.mean(depth)), len(position) / len(truth)


def batch_seconds(encoder: HertzGaussian, maps: np.ndarray) -> float:
    start = time.perf_counter()
    encoder.decode_batch(maps, GRID)
    return time.perf_counter() - start


def show_speed(rng: np.random.Generator) -> None:
    truth = triples(rng, MAPS)
    start = time.perf_counter()
    maps = HertzGaussian().encode_batch(truth, GRID)
    print(f"encode_batch: {MAPS / (time.perf_counter() - start):,.0f} maps/s")
    maps = noisy(rng, maps, 0.015, 0.003)
    for name, encoder in DECODERS.items():
        stage = ("decode", lambda one, encoder=encoder: encoder.decode(one[0], GRID))
        row = speed_rows(time_single([stage], maps[:300], threads=1, calls=3000), "single")[-1]
        best = min(batch_seconds(encoder, maps) for _ in range(5))
        print(
            f"{name:18s} one map p50 {1e3 * row['p50_ms']:5.0f} us, p90 {1e3 * row['p90_ms']:5.0f}"
            f" us; batch {MAPS / best:8,.0f} maps/s"
        )


def show_errors(rng: np.random.Generator) -> None:
    noises = {"clean": (0.0, 0.0), "network": (0.015, 0.003), "rough": (0.03, 0.01)}
    for kind, scenes in {"single": singles, "pair": pairs}.items():
        truth = scenes(rng, 500)
        maps = HertzGaussian().encode_batch(truth, GRID)
        for noise, (smooth, white) in noises.items():
            drawn = noisy(rng, maps, smooth, white)
            for name, encoder in DECODERS.items():
                position, depth, share = errors(encoder.decode_batch(drawn, GRID), truth)
                print(
                    f"{kind:6s} {noise:7s} {name:18s} position {position:.4f} mm,"
                    f" depth {depth:.4f} mm, right count {share:.3f}"
                )


if __name__ == "__main__":
    seeds = np.random.SeedSequence(1).spawn(2)
    show_speed(np.random.default_rng(seeds[0]))
    show_errors(np.random.default_rng(seeds[1]))
