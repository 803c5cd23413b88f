"""Declares the encoders of this package."""

from __future__ import annotations

from tactibench import EncoderSpec, Parameter, hookimpl

_MAX_DEPTH = Parameter("max_depth", 6.0, "depth of heat 1, mm", low=0.1, high=100.0)
_SIGMA = Parameter("sigma", 0.8, "width of the heat of a contact, mm", low=0.1, high=100.0)
_REACH = Parameter("reach", 2.0, "radius of the discs around a contact, mm", low=0.1, high=100.0)
_MAX_COUNT = Parameter("max_count", 6, "most contacts in a frame", low=1, high=64, decode_only=True)


def _threshold(default: float) -> Parameter:
    summary = "heat below which a peak is no contact"
    return Parameter("threshold", default, summary, low=1e-3, high=1.0, decode_only=True)


def _min_distance(default: float) -> Parameter:
    summary = "peaks closer than this are one, mm"
    return Parameter("min_distance", default, summary, low=0.0, decode_only=True)


@hookimpl
def tactibench_encoders() -> list[EncoderSpec]:
    """Return the heatmap of TactiVerse, and encoders with further maps."""
    return [
        EncoderSpec(
            name="hertz",
            target="tactibench_heatmaps.encoders:HertzGaussian",
            summary="one Gaussian per contact, height d / 6 mm, width by Hertz contact radius",
            parameters=(
                _MAX_DEPTH,
                Parameter("radius", 3.0, "indenter radius R in the width, mm", low=0.0, high=100.0),
                Parameter("blur", 2.0, "width added for the skin's compliance, mm", low=0.1),
                Parameter(
                    "decoder",
                    "wide",
                    "how peaks are read: fit of 11 x 11 cells (wide: 17 x 17), or the highest cell",
                    choices=("least-squares", "wide", "maximum"),
                    decode_only=True,
                ),
                _threshold(0.25 / 6.0),
                _min_distance(3.0),
                _MAX_COUNT,
                Parameter(
                    "width",
                    "kernel",
                    "width of the fitted peak: that of the kernel at its depth, or free",
                    choices=("kernel", "free"),
                    decode_only=True,
                ),
            ),
            shows_surface=True,
        ),
        EncoderSpec(
            name="depth",
            target="tactibench_heatmaps.encoders:HeatAndDepth",
            summary="a Gaussian of height 1 per contact, and depth on a map of its own",
            parameters=(
                _MAX_DEPTH,
                _SIGMA,
                _REACH,
                Parameter(
                    "decoder",
                    "least-squares",
                    "how the heat is read: sub-cell fit, or the cell of the maximum",
                    choices=("least-squares", "maximum"),
                    decode_only=True,
                ),
                _threshold(0.3),
                _min_distance(1.2),
                _MAX_COUNT,
            ),
        ),
        EncoderSpec(
            name="offset",
            target="tactibench_heatmaps.encoders:Offsets",
            summary="heat, steps from every cell near a contact to it, and depth",
            parameters=(
                _MAX_DEPTH,
                _SIGMA,
                _REACH,
                _threshold(0.3),
                _min_distance(1.2),
                _MAX_COUNT,
            ),
        ),
        EncoderSpec(
            name="mixture",
            target="tactibench_heatmaps.encoders:Mixture",
            summary="per cell a probability, place and depth of a contact with their std",
            parameters=(
                _threshold(0.3),
                Parameter(
                    "merge",
                    2.0,
                    "contacts of neighbouring cells closer than this are one, mm",
                    low=0.0,
                    high=100.0,
                    decode_only=True,
                ),
                _MAX_COUNT,
            ),
            kind="mixture",
        ),
    ]
