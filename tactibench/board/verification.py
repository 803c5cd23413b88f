"""One submission, checked and scored again; a message names the first thing that is wrong."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from tactibench.board.alarm import alarm
from tactibench.board.neighbours import Neighbours, find_neighbours
from tactibench.board.predictions import (
    Arrays,
    answers_file,
    check_answers,
    ranked_errors,
    read_answers_file,
    split_ranked,
)
from tactibench.board.provenance import (
    on_word,
    refuse_components,
    refuse_failures,
    refuse_too_many,
    refuse_underived,
)
from tactibench.board.record_forms import refuse_forms
from tactibench.board.rows import BOUND, below_bound, label_of, measured_on
from tactibench.board.submissions import (
    read_untrusted,
    refuse_misplaced,
    refuse_names,
    refuse_partial,
)
from tactibench.board.truth import Source, labelled_counts, make_test_set
from tactibench.errors import UserError, describe_exception
from tactibench.protocols import (
    board_spec,
    recorded_seed,
    recorded_version,
)
from tactibench.records import Metric, Record, arrays_hash, make_signature, parse_record
from tactibench.run import HIDDEN, LIMIT, failures_record, score_arrays

TOLERANCE = 1e-6
"""Relative tolerance; another processor or version of numpy sums in another order."""
LIMIT_TOLERANCE = 1e-3
"""Relative tolerance of a limit that is searched in rendered frames of single precision."""
NEGLIGIBLE_MM = 1e-6
"""Tolerance of the error of one press, which is near 0 where the truth is fitted to pins."""
MOST_S = 900.0
"""Most processor time for a file, thirty times that of the slowest shipped protocol. The time grows
with the size of a frame, which a record may choose."""
AGAIN_S = 0.2
"""Processor time after which a file is stopped again, where the first stop had no effect."""
EXCESS = "surface_excess_mm"
FROM_MAPS = frozenset({"surface_rmse_mm", "surface_floor_mm", EXCESS})
"""Metrics of heatmaps, which are not submitted."""

FORM = ("unit", "better", "censored", "method")
"""Fields of a metric that do not depend on what was measured."""


@dataclass(frozen=True)
class Verdict:
    """The verdict on a submission that was not refused.

    Attributes:
        path: File of the record.
        record: The record.
        frames: Number of test frames.
        again: Rows of metrics that were computed anew and equal the stated ones.
        stated: Everything that rests on the submitter's word, the names of metrics of heatmaps
            included.
        neighbours: Its place among the records beside it.
    """

    path: Path
    record: Record
    frames: int
    again: tuple[Metric, ...]
    stated: tuple[str, ...]
    neighbours: Neighbours

    @property
    def subject(self) -> str:
        """Name, such as "unet + hertz (single), seed 0 on simulated sensor tactip-127"."""
        record = self.record
        return f"{label_of(record)}, seed {record.seed} on {measured_on(record)}"

    def headline(self) -> list[Metric]:
        """Return the error that orders the board, with missed and spurious contacts or coverage."""
        ranking = board_spec(self.record.protocol.label).ranking
        wanted = [] if ranking is None else [(ranking.metric, ranking.group)]
        wanted += [(name, "all") for name in ("missed", "spurious", "coverage")]
        return [row for row in self.again if (row.metric, row.group) in wanted]

    def below_bound(self) -> list[Metric]:
        """Return the errors that are surely below the Cramer-Rao bound."""
        return [
            row for row in self.again if row.metric == BOUND and below_bound(row.value, row.high)
        ]


class _OutOfTimeError(BaseException):
    """The time of a file is up. It is no Exception, which plugins and libraries might catch."""


def verify(
    path: Path,
    source: Source,
    *,
    folder: Path | None = None,
    limit_s: float = MOST_S,
) -> Verdict:
    """Check and score one committed record. One file never stops the verification of others.

    Args:
        path: File of the record.
        source: Sources of the truth.
        folder: Folder of the published hashes of hidden seeds; None: those that ship with
            tactibench.
        limit_s: Most processor time that it may take, s.

    Raises:
        UserError: Something is wrong with the file, or something is missing to verify it. Any other
            exception of the code is turned into this verdict on the file.
    """

    def stop(_frame: FrameType | None) -> None:
        raise _OutOfTimeError

    try:
        with alarm("processor", limit_s, stop, again_s=AGAIN_S):
            return score_again(path, source, folder=folder)
    except _OutOfTimeError:
        raise UserError(
            f"{path} was not verified within {limit_s:g} s of processor time; run it on a sensor "
            "with smaller frames."
        ) from None
    except UserError:
        raise
    except Exception as error:
        raise UserError(
            f"{path} could not be scored again ({describe_exception(error)}); submit the run again."
        ) from error


def score_again(path: Path, source: Source, *, folder: Path | None = None) -> Verdict:
    """Check and score one committed record, without the guards of ``verify``.

    The arguments are those of ``verify``. An exception other than UserError is a mistake of
    tactibench.

    Raises:
        UserError: Something is wrong with the file, or something is missing to verify it.
    """
    values = read_untrusted(path)
    record = parse_record(values, str(path))
    refuse_names(record, str(path))
    refuse_misplaced(record, path)
    refuse_partial(record, str(path))
    stated = record.protocol
    protocol = recorded_version(stated.label, stated.hash, str(path))
    refuse_signature(record, str(path))
    refuse_forms(record, values, str(path))
    refuse_components(record, protocol, source.host, str(path))
    neighbours = find_neighbours(record, path)
    place = answers_file(path)
    if not place.is_file():
        raise UserError(
            f"{place} is missing: without its predictions a record cannot be scored again; "
            "`tactibench board submit` writes both."
        )
    answers, ranked = split_ranked(read_answers_file(place))
    if arrays_hash(answers) != record.identity.predictions_hash:
        raise UserError(
            f"the predictions in {place} are not those of {path.name} (hash "
            f"{arrays_hash(answers)[:12]}, the record says "
            f"{record.identity.predictions_hash[:12]}); submit the run again."
        )
    seed = None
    if record.test_sensor is not None and HIDDEN in record.test_sensor.options:
        seed = recorded_seed(protocol, record.identity.hidden or "", folder)
    test = make_test_set(record, protocol, source, seed)
    truth = test.truth
    times = len(labelled_counts(record, protocol)) or 1
    frames = len(truth["press"]) // times
    if record.data.test != frames:
        raise UserError(
            f"{path} says that it was tested on {record.data.test} frames, but the "
            f"protocol tests {frames:,}."
        )
    _refuse_maps(record, frames, str(path))
    refuse_underived(record, test.derived, protocol, str(path))
    guarded = bool(protocol.spec.families)
    check_answers(answers, protocol.spec.answer, frames * times, str(place), guarded=guarded)
    if protocol.spec.answer == "contacts":
        refuse_too_many(record, source.host, int(answers["count"].max(initial=0)), str(path))
    failed = failures_record(answers, truth["group"].tolist()) if guarded else None
    refuse_failures(record, failed, str(path))
    again = score_arrays(protocol.spec, truth, answers, {})
    on_trust = refuse_differences(record.metrics, again, str(path))
    _refuse_ranked(ranked, ranked_errors(protocol.spec, truth, answers), place)
    from_answers = tuple(row for row in again if row.metric not in FROM_MAPS)
    return Verdict(
        path, record, frames, from_answers, (*on_word(test.derived), *on_trust), neighbours
    )


def refuse_signature(record: Record, where: str) -> None:
    """Raise UserError unless the signature, which boards show, agrees with the record."""
    stated, derived = record.signature.split("|"), make_signature(record).split("|")
    for before, after in zip_longest(stated, derived, fillvalue="nothing more"):
        if before != after:
            raise UserError(
                f"{where}: the signature says {before!r}, but the record says {after!r}."
            )


def refuse_differences(
    stated: Sequence[Metric], again: Sequence[Metric], where: str
) -> tuple[str, ...]:
    """Raise UserError where a stated row is not what the answers give.

    Args:
        stated: Rows of the record.
        again: Rows computed from the answers.
        where: Name of the record in messages.

    Returns:
        Names of the metrics that are stated and cannot be computed without heatmaps.
    """
    before, after = ({(row.metric, row.group): row for row in rows} for rows in (stated, again))
    if len(before) < len(stated):
        raise UserError(f"{where} states a metric of a group twice.")
    for metric, group in sorted({*before, *after}):
        row, computed = before.get((metric, group)), after.get((metric, group))
        if row is None or computed is None:
            verb = "lacks" if row is None else "states"
            raise UserError(
                f"{where} {verb} {metric} of {group}, which the protocol "
                f"{'asks for' if row is None else 'does not ask for'}."
            )
        for field in FORM if metric in FROM_MAPS else Metric.model_fields:
            tolerance = LIMIT_TOLERANCE if metric == LIMIT else TOLERANCE
            if not _is_equal(getattr(row, field), getattr(computed, field), tolerance):
                raise UserError(
                    f"{where} states {field} {getattr(row, field)} for {metric} of {group}, but "
                    f"its predictions give {getattr(computed, field)}."
                )
    return tuple(
        sorted({row.metric for row in stated if row.metric in FROM_MAPS and row.value is not None})
    )


def _refuse_maps(record: Record, frames: int, where: str) -> None:
    """Raise UserError for errors of heatmaps that the run cannot have measured."""
    none = record.identity.stored["maps"] == arrays_hash({})
    for row in record.metrics:
        if row.metric not in FROM_MAPS:
            continue
        if (
            row.n > frames
            or row.clusters > frames
            or ((row.value or 0.0) < 0 and row.metric != EXCESS)
        ):
            raise UserError(f"{where}: {row.metric} of {row.group} is of no test of this protocol.")
        measured = (row.value, row.low, row.high)
        if (none or row.value is None) and (measured != (None,) * 3 or (none and row.n)):
            raise UserError(
                f"{where} states {row.metric} {measured}, but its run stored no such heatmaps."
            )


def _is_equal(stated: Any, again: Any, tolerance: float) -> bool:
    if isinstance(stated, float | int) and isinstance(again, float):
        return math.isclose(stated, again, rel_tol=tolerance, abs_tol=1e-9)
    return bool(stated == again)


def _refuse_ranked(stated: Arrays, again: Arrays, place: Path) -> None:
    """Raise UserError unless the errors that a board ranks by are those of the answers."""
    same = set(stated) == set(again) and all(
        stated[name].shape == array.shape
        and stated[name].dtype.kind == array.dtype.kind
        and (
            np.allclose(stated[name], array, rtol=TOLERANCE, atol=NEGLIGIBLE_MM)
            if array.dtype.kind == "f"
            else bool((stated[name] == array).all())
        )
        for name, array in again.items()
    )
    if not same:
        raise UserError(
            f"the errors of single presses in {place}, by which a board ranks, are not those of "
            "its predictions; submit the run again."
        )


def metric_rows(verdict: Verdict) -> Iterable[dict[str, Any]]:
    """Yield tidy rows of the metrics that were computed anew."""
    for row in verdict.again:
        yield {"file": verdict.path.name, "state": "verified", **row.json_values()}
