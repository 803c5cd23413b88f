"""Which metrics of a protocol stand in which table; misses stand beside every error."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Column:
    """A metric. interval: shown below the value; spread: over seeds, in a column of its own."""

    metric: str
    group: str
    head: str
    decimals: int
    interval: bool = True
    spread: bool = True


@dataclass(frozen=True)
class Block:
    """A table. optional: left out where no row has its first column."""

    title: str
    columns: tuple[Column, ...]
    note: str = ""
    optional: bool = False


def _aside(metric: str, group: str, head: str, decimals: int) -> Column:
    return Column(metric, group, head, decimals, interval=False, spread=False)


def _miss(group: str = "all") -> tuple[Column, Column]:
    return (
        Column("missed", group, "missed, %", 2, interval=False),
        Column("spurious", group, "spurious / frame", 3, interval=False),
    )


def _contacts(group: str, title: str) -> Block:
    return Block(
        title,
        (
            Column("gospa1_mm", group, "GOSPA, mm", 3),
            Column("position_mean_mm", group, "position, mm", 3),
            Column("depth_mae_mm", group, "depth, mm", 3),
            Column("relative_depth_mae_mm", group, "relative depth, mm", 3, interval=False),
            *_miss(group),
        ),
        "Position and depth: over contacts matched inside the gate. GOSPA: p = 1, a missed or "
        "spurious contact costs half the gate.",
    )


_MISSED = _aside("missed", "all", "missed, %", 2)

_STATED = Block(
    "Stated uncertainty",
    (
        Column("nll", "all", "NLL", 2, interval=False),
        Column("rms_z", "all", "rms z", 2, interval=False),
        Column("ellipse_50", "all", "in 50 %, %", 1, interval=False),
        Column("ellipse_90", "all", "in 90 %, %", 1, interval=False),
        Column("ellipse_95", "all", "in 95 %, %", 1, interval=False),
        _MISSED,
    ),
    "Models that state a standard deviation for every contact: Gaussian negative log likelihood, "
    "rms of the standardised errors (1 is honest), and how many true contacts lie inside the "
    "stated 50, 90 and 95 % ellipses.",
    optional=True,
)


_BOUND = Block(
    "RMSE over the Cramer-Rao bound",
    (
        *(Column("rmse_over_bound", axis, axis, 1) for axis in "xyz"),
        _MISSED,
    ),
    "1 is what the noise of the sensor's frames allows.",
    optional=True,
)

_SURFACE = Block(
    "Heatmap as deformed surface",
    (Column("surface_rmse_mm", "all", "surface RMSE, mm", 4), _MISSED),
    "Heatmap x 6 mm against the true inward displacement of the skin.",
    optional=True,
)

_FOR_SOME = (_BOUND, _SURFACE, _STATED)

SHOTS = ("0", "10", "50", "200")


def _by_shots(metric: str, title: str, decimals: int, note: str) -> Block:
    """A column for every number of labelled frames; models that take none have the first alone."""
    columns = (Column(metric, shots, shots, decimals, spread=False) for shots in SHOTS)
    return Block(title, (*columns, _aside("coverage", "0", "answered, %", 1)), note)


DISTANCES = tuple(f"{0.5 * k:.1f}" for k in range(13, 25))

BLOCKS: dict[str, tuple[Block, ...]] = {
    "exp1": (
        Block(
            "Error",
            (
                Column("mae_mm", "mean", "MAE, mm", 4),
                Column("rmse_mm", "mean", "RMSE, mm", 4),
                Column("r2", "mean", "R2", 4, interval=False),
                *_miss(),
            ),
            "Means over x, y and depth of the best-scored prediction, without a gate.",
        ),
        Block(
            "By axis",
            (
                *(Column("mae_mm", axis, f"MAE {axis}, mm", 4) for axis in "xyz"),
                *(_aside("rmse_mm", axis, f"RMSE {axis}, mm", 4) for axis in "xyz"),
                _MISSED,
            ),
            "z is depth.",
        ),
        *_FOR_SOME,
    ),
    "exp2": (
        Block(
            "Distance of the tips",
            (
                Column("distance_penalised_mm", "all", "penalised error, mm", 3),
                Column("distance_mae_mm", "all", "error, mm", 3),
                Column("resolved", "all", "resolved, %", 1),
                Column("threshold_mm", "all", "threshold, mm", 2),
                _MISSED,
            ),
            "Error: over resolved pairs only. Penalised: an unresolved pair counts its true "
            'distance. Threshold: the distance at which 75 % are resolved; "<": below all '
            "distances that were pressed.",
        ),
        Block(
            "Penalised error by true distance, mm",
            tuple(_aside("distance_penalised_mm", d, d, 2) for d in DISTANCES),
            "The share of pairs that were resolved stands below, in %.",
        ),
        Block(
            "Contacts",
            (
                Column("gospa1_mm", "all", "GOSPA, mm", 3),
                Column("position_mean_mm", "all", "position, mm", 3),
                Column("depth_mae_mm", "all", "depth, mm", 3),
                *_miss(),
            ),
        ),
        Block(
            "One or two, and how turned",
            (
                Column("catch_resolved", "all", "single seen as two, %", 1),
                Column("d_prime", "all", "d'", 2),
                Column("orientation_mae_deg", "all", "turn, deg", 2),
                _MISSED,
            ),
        ),
        *_FOR_SOME,
    ),
    "exp3": (
        _contacts("all", "All frames"),
        _contacts("dual", "Two contacts"),
        _contacts("triple", "Three contacts"),
        *_FOR_SOME,
    ),
    "surface": (
        Block(
            "Flat plate",
            (
                Column("depth_mae_mm", "all", "depth MAE, mm", 4),
                Column("tilt_mae_deg", "all", "tilt MAE, deg", 3),
                Column("coverage", "all", "answered, %", 2),
            ),
            "Over answered frames.",
        ),
        Block(
            "Against the released predictions, frame for frame",
            (
                Column("depth_mae_minus_published_mm", "tac-vgnn", "depth MAE, mm", 4),
                _aside("depth_mae_minus_published_p", "tac-vgnn", "p", 4),
                Column("tilt_mae_minus_published_deg", "tac-vgnn", "tilt MAE, deg", 3),
                _aside("tilt_mae_minus_published_p", "tac-vgnn", "p", 4),
                _aside("coverage", "all", "answered, %", 2),
            ),
            "This row's error minus that of the released predictions of tac-vgnn, over the frames "
            "that both answered: below zero where this row is nearer to the label. p: two-sided "
            "sign-flip permutation test of the paired differences; at 0.0001 no one of 9,999 "
            "permutations was as far from zero. A mean over seeds; not adjusted for the number of "
            "rows.",
            optional=True,
        ),
    ),
    "stability": (
        Block(
            "All cases",
            (
                Column("ospa_mm", "all", "OSPA, mm", 3),
                Column("worst_ratio", "all", "worst ratio", 1, interval=False),
                Column("false_per_1000", "all", "false / 1,000 empty", 1),
                _aside("not_finite", "all", "not finite", 0),
                _aside("raised", "all", "raised", 0),
                *_miss(),
            ),
            "OSPA: mean over frames of the error in x, y and depth a contact, where a missed or "
            "false contact counts the gate. Worst ratio: the largest error of a case over that of "
            "its family's easy case. Not finite, raised: frames on which the model answered NaN "
            "or infinity, or raised an exception.",
        ),
    ),
    "transfer": (
        _by_shots(
            "depth_mae_mm",
            "Indentation MAE, mm, by labelled frames of the tested sensor",
            3,
            "Over answered frames.",
        ),
        _by_shots(
            "tilt_mae_deg",
            "Tilt MAE, deg, by labelled frames of the tested sensor",
            2,
            "Over answered frames; those without labelled frames stand in the first table.",
        ),
    ),
}
BENEATH = {"distance_penalised_mm": "resolved"}
"""A share that stands below an error in a column of one distance."""
