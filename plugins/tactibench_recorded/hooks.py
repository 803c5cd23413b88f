"""Declarations of this plugin."""

from __future__ import annotations

from tactibench import Parameter, SensorSpec, hookimpl


@hookimpl
def tactibench_sensors() -> list[SensorSpec]:
    """Declare the sensor of recorded folders."""
    return [
        SensorSpec(
            "recorded",
            "tactibench_recorded.sensor:RecordedSensor",
            "a folder of recorded frames: targets.csv, CSV, or a data set",
            (
                Parameter(
                    "range",
                    "auto",
                    "presses that protocols of spherical tips take: published, those in their own "
                    "range; own, all; auto: all where the sensor is flat",
                    choices=("auto", "published", "own"),
                ),
                Parameter(
                    "depth_offset_mm",
                    5.0,
                    "added to the depth label, so that depth is counted from about first touch; "
                    "presses that a data set knows are taken as they are",
                    low=-100.0,
                    high=100.0,
                ),
                Parameter(
                    "pivot_mm",
                    0.0,
                    "p of depth = label + offset + p (1 - cos tilt) + q sin tilt, see "
                    "`tactibench data fit`",
                    low=-1000.0,
                    high=1000.0,
                ),
                Parameter("pivot_side_mm", 0.0, "q of that depth", low=-1000.0, high=1000.0),
                Parameter(
                    "labels",
                    "auto",
                    "given: read by those three numbers; fitted: all taken from the "
                    "pins, as `tactibench data fit` does; auto: fitted where depths of two sensors "
                    "are compared and neither was given",
                    choices=("auto", "given", "fitted"),
                ),
                Parameter(
                    "depth",
                    "pose_2",
                    "column of targets.csv with the depth label, mm (-COLUMN: counted the other "
                    "way); pose_x..pose_Rz are the same columns as pose_1..pose_6",
                ),
                Parameter("tilt", "pose_6", "column of targets.csv with the plate's tilt, deg"),
                Parameter(
                    "light",
                    "auto",
                    "frames: as_is; even: raw camera pictures, of which pins are cut out and "
                    "evenly lit; auto: what shows more pins",
                    choices=("auto", "as_is", "even"),
                    checks_only=True,  # what it changes is described: cut_out
                ),
                Parameter(
                    "trust_labels",
                    False,
                    "take labels that the frames contradict; a row shows it",
                    checks_only=True,
                ),
                Parameter(
                    "split",
                    "",
                    "who trains, validates and tests: NAME of splits/NAME.json of a data set; "
                    "empty: as the protocol divides",
                ),
            ),
            origin="real",
            needs_data=True,
        )
    ]
