"""No tiny constant hides a NaN: every one in models, losses, metrics and intervals is explained."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from small_constants import occurrences

from tactibench import __file__ as package

ROOT = Path(package).parents[1]
SOURCES = (
    "tactibench/training",
    "tactibench/metrics",
    "tactibench/stats",
    "tactibench/superposition",
    *(
        f"plugins/tactibench_{name}"
        for name in ("baselines", "cnn", "unet", "vgnn", "mixture", "pins", "superpose", "heatmaps")
    ),
)

KEEPS = "numpy's and torch's bounds keep a NaN; "
ROUNDING = "room for rounding in a comparison; "
EXPLAINED = {
    # training
    ("training/mixture_model.py", "_factors"): KEEPS + "a std that is never wrong is still no 0",
    ("training/mixture.py", "mixture_loss"): "rows of NaN are no contact, and are left out of the "
    "sum by a mask taken before; a NaN of the network is not touched",
    ("training/muon.py", "orthogonalise"): KEEPS + "a gradient of 0 stays 0",
    # metrics and intervals
    ("metrics/threshold.py", "_most_likely"): ROUNDING + "no value is changed",
    ("stats/bootstrap.py", "bca_interval"): "only where the other branch of np.where is taken",
    (
        "stats/bootstrap.py",
        "r_squared.statistic",
    ): "an empty resample has a sum of 0 to divide; its "
    "0 / 0 stays NaN, which the interval counts as lost",
    # superposition
    ("superposition/neighbours.py", "_pair_of"): KEEPS + "two contacts in one place have no "
    "direction",
    ("superposition/neighbours.py", "_robust"): "Huber's weight of a residual of 0 is 1; one of a "
    "NaN is NaN",
    (
        "superposition/family.py",
        "Clues.learn",
    ): "max(x, ...) with x first keeps a NaN; sensors that look alike at rest",
    (
        "superposition/compiled.py",
        "fit_frame",
    ): "a pin field that feels nothing gives a matrix of 0; a NaN in it stays",
    ("superposition/picture.py", "_background"): KEEPS + "0 / 0 where no image shows skin is 0, "
    "and not used where any does",
    ("superposition/residual.py", "Residual.learn"): KEEPS + "pairs that add up exactly leave 0",
    # models
    ("tactibench_unet/architecture.py", "UNetNetwork.initialise"): KEEPS + "the logit of a mean "
    "heat of 0 or 1 would be infinite",
    ("tactibench_unet/model.py", "_is_symmetric"): "a question with yes or no for an answer",
    ("tactibench_vgnn/architecture.py", "GraphNetwork.__init__"): KEEPS + "one pin has no extent",
    ("tactibench_vgnn/layout.py", "PinLayout.learn"): "a pin that the rest frame does not show has "
    "no radius (NaN); it stands as 0, for which no swelling is learned",
    ("tactibench_mixture/architecture.py", "MixtureNetwork.initialise"): KEEPS + "frames in which "
    "nothing moved",
    ("tactibench_pins/regression.py", "Features.places"): "max(x, ...) with x first keeps a NaN; "
    "frames in which nothing moved",
    ("tactibench_pins/displacements.py", "Components.weights"): KEEPS
    + "a component without spread",
    ("tactibench_pins/transfer.py", "Correction.fit"): "max(x, ...) with x first keeps a NaN; "
    "features that are all alike",
    ("tactibench_superpose/detect.py", "Detector.of"): ROUNDING + "the end of a range",
    ("tactibench_superpose/spread.py", "Spread.std"): KEEPS + "a stated std is no 0",
    ("tactibench_superpose/spread.py", "_fit_terms"): KEEPS + "errors of 0 have no variance",
    # encoders, whose maps are checked to be finite before they are read
    ("tactibench_heatmaps/axes.py", "_peak"): KEEPS + "a profile of 0 has no logarithm, and a fit "
    "that is not concave is dropped below",
    ("tactibench_heatmaps/encoder.py", "relative_depth"): ROUNDING + "a depth is at most max_depth",
    ("tactibench_heatmaps/least_squares.py", "_fit_peaks"): "a fit that is not concave is dropped "
    "by ``near``, which is false for a NaN",
    (
        "tactibench_heatmaps/least_squares.py",
        "_gauss_newton_step",
    ): "a peak of one cell has a singular matrix",
    ("tactibench_pins/augmentation.py", "_unlikelihood"): "channels that never change have no "
    "variance to take the logarithm of; NaN in them is refused before",
    ("tactibench_heatmaps/dark.py", "_move_peak"): KEEPS + "a map of 0 has no logarithm",
}
"""Function -> why its constant hides nothing."""
EXPECTED = Counter(
    {
        ("tactibench_unet/architecture.py", "UNetNetwork.initialise"): 2,
        ("superposition/family.py", "Clues.learn"): 2,
        ("tactibench_superpose/spread.py", "_fit_terms"): 3,
        ("tactibench_heatmaps/axes.py", "_peak"): 3,
    }
)
"""How many a function holds, where it is not one."""


def found() -> Counter[tuple[str, str]]:
    files = [path for source in SOURCES for path in sorted((ROOT / source).rglob("*.py"))]
    assert len(files) > 50
    return Counter(
        ("/".join(path.parts[-2:]), function) for path in files for function, _ in occurrences(path)
    )


@pytest.mark.skipif(not (ROOT / "plugins").is_dir(), reason="not a checkout")
def test_every_tiny_constant_is_explained() -> None:
    wanted = Counter(dict.fromkeys(EXPLAINED, 1)) | EXPECTED
    here = found()
    assert not here - wanted, "explain these in EXPLAINED, or let a NaN through"
    assert not wanted - here, "these are gone: take them out of EXPLAINED"


@pytest.mark.parametrize(
    ("line", "count"),
    [
        ("a = x + 1e-9", 1),
        ("a = 1e-12 + x", 1),
        ("a -= 1e-6", 1),
        ("a = x.clamp_min(1e-8)", 1),
        ("a = np.maximum(x, 1e-6)", 1),
        ("a = min(x, -1e-9)", 1),
        ("a = x.clip(0.001, 1.0)", 1),
        ("a = x.nan_to_num()", 1),
        ("a = np.nanmean(x)", 1),
        ("a = norm(x, eps=1e-5)", 1),
        ("E = 1e-7\na = x + E", 1),
        ("a = np.fmax(x, y)", 1),
        ("a = x + 1", 0),
        ("a = x * 1e-9", 0),
        ("a = x < 1e-9", 0),
        ("a = np.maximum(x, 1.0)", 0),
        ("a = x + 0.0", 0),
    ],
)
def test_what_counts_as_one(tmp_path: Path, line: str, count: int) -> None:
    file = tmp_path / "some.py"
    file.write_text(f"{line}\n", encoding="utf-8")
    assert len(occurrences(file)) == count
