"""Declaration of the model ``unet``."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench import ModelSpec, Parameter, hookimpl, training_parameters


@hookimpl
def tactibench_models() -> Iterable[ModelSpec]:
    """Declare the model ``unet``."""
    return [
        ModelSpec(
            name="unet",
            target="tactibench_unet.model:UNet",
            summary="U-Net from frame to heatmap, contacts read by the encoder (TactiVerse)",
            parameters=(
                Parameter("recipe", "default", "training recipe", choices=("default", "paper")),
                Parameter("width", 8, "channels of the first level", choices=(8, 16, 32, 64)),
                Parameter("size", 128, "frames are resized to this, px", choices=(64, 96, 128)),
                Parameter("stem", 4, "stride of the first convolutions", choices=(1, 2, 4)),
                *training_parameters(mixing=False),
                Parameter(
                    "mixing",
                    -1.0,
                    "extra multi-contact frames made from single presses, share of the presses; "
                    "-1: the recipe's, where the frames allow it",
                    low=-1.0,
                    high=10.0,
                ),
                Parameter(
                    "neighbours",
                    "dome",
                    "what mixed contacts do to each other: dome (mechanics of a nominal dome) or "
                    "none (plain addition)",
                    choices=("dome", "none"),
                ),
                Parameter(
                    "faults",
                    0.0,
                    "share of the training frames under faults of camera and light",
                    low=0.0,
                    high=1.0,
                ),
            ),
            refinable=True,
            answers=("contacts", "plate"),
            max_contacts=None,
            uses_encoder=True,
            recipes={"paper": {"stem": 2, "mixing": 0.0}},
        )
    ]
