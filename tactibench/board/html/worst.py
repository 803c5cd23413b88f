"""The frames that a model answers worst, with the truth and its answer drawn over each other."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tactibench.board.html.answers import Answered
from tactibench.board.html.figure import Figure, Option, Panel, Trace, axis, lines
from tactibench.board.html.opened import Opened
from tactibench.board.rows import Row
from tactibench.contacts import Contacts, FloatArray
from tactibench.metrics.gospa import gospa_per_frame
from tactibench.metrics.groups import members
from tactibench.metrics.location import axis_mean_errors
from tactibench.metrics.trials import Trials
from tactibench.records.record import Record

WORST = 3
ROWS = 8
"""Rows of a section that are shown, the best first."""
PIXELS = 160
"""A side of a frame in the page, at most."""
QUALITY = 80


@dataclass(frozen=True, eq=False)
class _Chosen:
    """A row's worst frames. among: rows of the frames at hand, None for all."""

    row: Row
    found: Answered
    trials: Trials
    errors: FloatArray
    worst: tuple[int, ...]
    among: Sequence[int] | None


def worst_frames(rows: Sequence[Row], opened: Opened) -> Panel | None:
    """A choice of rows; None where no answers in contacts are at hand."""
    able = [row for row in rows if not row.trivial][:ROWS]
    chosen = [one for row in able if (one := _choose(row, opened)) is not None]
    if not chosen:
        return None
    images: dict[str, dict[int, npt.NDArray[np.uint8]]] = {}
    for key, group in _alike(chosen, opened).items():
        wanted = sorted({k for one in group for k in one.worst})
        images[key] = opened.frames(group[0].row.first, wanted)
    options = [_option(one, images[opened.frames_key(one.row.first)]) for one in chosen]
    caption = (
        "Beside each frame: a ring of the tip's radius at every true contact, a cross at every "
        "predicted one; hover for depths. Ordered by the error of the frame: in exp1 the mean over "
        "x, y and depth, elsewhere GOSPA (p = 1), in which a miss costs half the gate."
    )
    return Panel("Worst frames", caption, tuple(options), "model")


def _alike(chosen: Sequence[_Chosen], opened: Opened) -> dict[str, list[_Chosen]]:
    """Rows whose frames are the same, so that each is made once."""
    found: dict[str, list[_Chosen]] = {}
    for one in chosen:
        found.setdefault(opened.frames_key(one.row.first), []).append(one)
    return found


def _choose(row: Row, opened: Opened) -> _Chosen | None:
    found = opened.of(row.first)
    if found is None or not isinstance(found.trials, Trials):
        return None
    errors = frame_errors(found, found.trials)
    among = opened.at_hand(row.first)
    order = [int(k) for k in np.argsort(-errors, kind="stable") if errors[k] > -np.inf]
    if among:
        order = [k for k in order if k in set(among)]
    return _Chosen(row, found, found.trials, errors, tuple(order[:WORST]), among)


def frame_errors(found: Answered, trials: Trials) -> FloatArray:
    """(N,) mm; an unanswered frame of exp1 is the worst there is, catch trials are none."""
    if found.single:
        sample = axis_mean_errors(trials)
        errors = np.full(len(trials), np.inf)
        errors[sample.trial] = sample.values
    else:
        errors = gospa_per_frame(trials, 1).values.copy()
    errors[~members(trials, "all")] = -np.inf
    return errors


def _option(one: _Chosen, images: dict[int, npt.NDArray[np.uint8]]) -> Option:
    figures = tuple(
        _figure(k, one.found, one.trials, one.errors[k], images.get(k)) for k in one.worst
    )
    note = _note(one.row.first, one.among, one.trials, made=bool(images))
    return Option(one.row.label, figures, note)


def _note(record: Record, among: Sequence[int] | None, trials: Trials, *, made: bool) -> str:
    seed = f"Seed {record.seed}"
    if among:
        return f"{seed}, of the {len(among)} frames that the run kept; {len(trials):,} were tested."
    of = f"{seed}, of all {len(trials):,} test frames"
    if not made:
        return f"{of}; the frames themselves are not at hand: run the protocol here to cache them."
    return f"{of}."


def _figure(
    row: int,
    found: Answered,
    trials: Trials,
    error: float,
    image: npt.NDArray[np.uint8] | None,
) -> Figure:
    truth, answer = trials.truth[row], trials.predictions[row]
    tip = max((draw.radius_mm for draw in found.keys.draws), default=0.0)
    half = found.keys.workspace.half_width_mm + tip
    square = {"range": [half, -half], "scaleanchor": "x", "constrain": "domain"}
    layout = {
        "xaxis": axis("x, mm", range=[-half, half], constrain="domain", dtick=5),
        "yaxis": axis("y, mm", dtick=5, **square),
        "margin": {"l": 34, "r": 4, "t": 4, "b": 36},
        "font": {"size": 11},
        "shapes": [_ring(x, y, tip) for x, y in truth.xy.tolist()],
    }
    size = "no answer" if not np.isfinite(error) else f"{error:.3f} mm"
    group = "" if trials.group[row] == "all" else f", {_group(trials.group[row])}"
    caption = f"{found.presses[row]}{group}: {size}; {len(truth)} true, {len(answer)} predicted"
    traces = (_points("true", truth), _points("predicted", answer))
    shown = "" if image is None else _jpeg(image)
    return Figure(traces, layout, height=210, image=shown, caption=caption, small=True)


def _group(name: str) -> str:
    return f"{name} mm apart" if name[:1].isdigit() else name


def _ring(x: float, y: float, r: float) -> Trace:
    return {
        "type": "circle",
        "x0": x - r,
        "x1": x + r,
        "y0": y - r,
        "y1": y + r,
        "line": {"color": "#009E73", "width": 2},
    }


def _points(kind: str, contacts: Contacts) -> Trace:
    text = [
        lines(
            f"{kind} contact",
            f"x {x:.2f}, y {y:.2f} mm",
            f"depth {depth:.2f} mm",
            "" if kind == "true" else f"score {score:.2f}",
        )
        for (x, y), depth, score in zip(
            contacts.xy.tolist(), contacts.depth.tolist(), contacts.score.tolist(), strict=True
        )
    ]
    look = (
        {"symbol": "circle", "size": 6, "color": "#009E73"}
        if kind == "true"
        else {
            "symbol": "x-thin",
            "size": 11,
            "color": "#D55E00",
            "line": {"width": 2.6, "color": "#D55E00"},
        }
    )
    return {
        "type": "scatter",
        "mode": "markers",
        "name": kind,
        "showlegend": False,
        "x": contacts.xy[:, 0].round(3).tolist(),
        "y": contacts.xy[:, 1].round(3).tolist(),
        "marker": look,
        "hoverinfo": "text",
        "hovertext": text,
    }


def _jpeg(image: npt.NDArray[np.uint8]) -> str:
    """Data URI of a JPEG file, no larger than a page needs: a third of the bytes of a PNG."""
    import cv2

    step = max(1, -(-max(image.shape[:2]) // PIXELS))
    shown = np.ascontiguousarray(image[::step, ::step, ...])
    if shown.ndim == 3:
        shown = np.asarray(cv2.cvtColor(shown, cv2.COLOR_RGB2BGR), dtype=np.uint8)
    _, data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return f"data:image/jpeg;base64,{base64.b64encode(data.tobytes()).decode()}"
