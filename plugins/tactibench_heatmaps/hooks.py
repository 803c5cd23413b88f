"""Declares the encoders of this package."""

from __future__ import annotations

from tactibench import EncoderSpec, Parameter, hookimpl


@hookimpl
def tactibench_encoders() -> list[EncoderSpec]:
    """The depth-weighted Hertz-Gaussian heatmap of TactiVerse."""
    return [
        EncoderSpec(
            name="hertz",
            target="tactibench_heatmaps.hertz:HertzGaussian",
            summary="one Gaussian per contact, height d / 6 mm, width by Hertz contact radius",
            parameters=(
                Parameter("max_depth", 6.0, "depth of heat 1, mm", low=0.1, high=100.0),
                Parameter("radius", 3.0, "indenter radius R in the width, mm", low=0.0, high=100.0),
                Parameter("blur", 2.0, "width added for the skin's compliance, mm", low=0.1),
                Parameter(
                    "decoder",
                    "least-squares",
                    "how peaks are read: sub-cell fit, or the cell of the maximum",
                    choices=("least-squares", "maximum"),
                    decode_only=True,
                ),
                Parameter(
                    "threshold",
                    0.25 / 6.0,
                    "heat below which a peak is no contact",
                    low=1e-3,
                    high=1.0,
                    decode_only=True,
                ),
                Parameter(
                    "min_distance",
                    3.0,
                    "peaks closer than this are one, mm",
                    low=0.0,
                    decode_only=True,
                ),
                Parameter(
                    "max_count", 6, "most contacts in a frame", low=1, high=64, decode_only=True
                ),
                Parameter(
                    "window",
                    11,
                    "side of the least-squares window, cells (odd)",
                    choices=(5, 7, 9, 11, 13, 15, 17),
                    decode_only=True,
                ),
                Parameter(
                    "width",
                    "free",
                    "width of the fitted peak: free, or that of the kernel at its depth",
                    choices=("free", "kernel"),
                    decode_only=True,
                ),
            ),
        )
    ]
