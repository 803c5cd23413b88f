#!/usr/bin/env python
"""Draw the README's picture and write its table, from the committed records.

python scripts/draw_readme.py            # docs/images/instances.png and the table of README.md
python scripts/draw_readme.py --check    # exit code 1 when the table is not what they give
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import click

from tactibench.records.record import Record

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURE = ROOT / "README.md", ROOT / "docs" / "images" / "instances.png"
SUBMISSIONS = ROOT / "leaderboards" / "submissions"
BEGIN, END = "<!-- table: python scripts/draw_readme.py -->", "<!-- end of table -->"
INSTANCES = ("individual:1", "individual:2", "individual:3", "individual:4")
"""Cases of protocol stability: four other sensors of the same make press the plain presses."""
PLAIN = "plain:0"
NETWORKS = {"unet": "hertz", "mixture": "mixture"}
"""The encoder with which a model stands in the README; others have rows on the boards."""
HEADS = (
    "model",
    "one contact, mm",
    "two contacts: resolved, %",
    "nominal sensor, mm",
    "other instances, mm",
    "real plates, mm",
    "frame to contacts, ms",
)


@dataclass
class Model:
    """The committed records of one model trained on single presses, by protocol."""

    name: str
    records: dict[str, list[Record]] = field(default_factory=dict)

    def mean(self, protocol: str, metric: str, group: str) -> float | None:
        """Return the mean over training seeds, None where there is no record or no value."""
        values = [record.value(metric, group) for record in self.newest(protocol)]
        known = [value for value in values if value is not None]
        return statistics.fmean(known) if known else None

    def newest(self, protocol: str) -> list[Record]:
        """Return the records of the newest version of a protocol that the model was run on."""
        records = self.records.get(protocol, [])
        newest = max((record.protocol.version for record in records), default=0)
        return [record for record in records if record.protocol.version == newest]

    @property
    def instances(self) -> float | None:
        """Mean OSPA over the four other instances, mm."""
        values = [self.mean("stability", "ospa_mm", case) for case in INSTANCES]
        known = [value for value in values if value is not None]
        return statistics.fmean(known) if known else None

    @property
    def latency(self) -> float | None:
        """p90 of one frame on one thread, ms, of the least disturbed seed."""
        rows = [
            row.p90_ms
            for record in self.newest("exp1")
            for row in record.speed
            if (row.scenario, row.threads, row.phase) == ("single", 1, "total")
        ]
        return min(rows, default=None)


def read_models() -> list[Model]:
    """Return all models, those with the smallest error on other instances first."""
    models: dict[str, Model] = {}
    for path in sorted(SUBMISSIONS.glob("*/*.json")):
        record = Record.model_validate_json(path.read_text(encoding="utf-8"))
        if _plain(record):
            model = models.setdefault(record.model.name, Model(record.model.name))
            model.records.setdefault(record.protocol.id, []).append(record)
    shown = [model for model in models.values() if model.instances is not None]
    return sorted(shown, key=lambda model: model.instances or 0.0)


def _plain(record: Record) -> bool:
    """Whether a run is one of the README: single presses, defaults, the nominal sensor."""
    parameters = record.model.parameters
    encoder = record.encoder.name if record.encoder else None
    return (
        record.protocol.id in ("exp1", "exp2", "stability", "surface")
        and record.regime in ("single", "recorded")
        and record.sensor.test_sensor is None
        and (record.protocol.id == "surface" or record.sensor.origin == "simulated")
        and not record.sensor.parameters.get("instance")
        and record.limits.presses is None
        and "mixing" not in record.model.changed
        and parameters.get("recipe", "default") == "default"
        and parameters.get("neighbours", "dome") == "dome"
        and encoder in (None, NETWORKS.get(record.model.name))
        and (record.protocol.id != "surface" or record.data.published_frames)
    )


def table_lines(models: list[Model]) -> Iterator[str]:
    """Yield the lines of the README's table."""
    yield "| " + " | ".join(HEADS) + " |"
    yield "| --- |" + " ---: |" * (len(HEADS) - 1)
    for model in models:
        resolved = model.mean("exp2", "resolved", "all")
        cells = (
            f"`{model.name}`",
            _text(model.mean("exp1", "mae_mm", "mean"), "{:.4f}"),
            _text(None if resolved is None else 100 * resolved, "{:.1f}"),
            _text(model.mean("stability", "ospa_mm", PLAIN), "{:.3f}"),
            _text(model.instances, "{:.2f}"),
            _text(model.mean("surface", "depth_mae_mm", "all"), "{:.3f}"),
            _text(model.latency, "{:.1f}"),
        )
        yield "| " + " | ".join(cells) + " |"


def _text(value: float | None, form: str) -> str:
    return "n/a" if value is None else form.format(value)


def draw(models: list[Model], path: Path) -> None:
    """Draw, for every model, the error on the nominal sensor and on its four other instances."""
    from matplotlib.figure import Figure

    from tactibench.report.plots.style import model_look

    figure = Figure(figsize=(8.0, 0.38 * len(models) + 1.3), layout="constrained")
    axes = figure.subplots()
    for place, model in enumerate(reversed(models)):
        nominal = model.mean("stability", "ospa_mm", PLAIN) or 0.0
        others = [model.mean("stability", "ospa_mm", case) or 0.0 for case in INSTANCES]
        colour = model_look(model.name).color
        axes.plot([nominal, max(others)], [place, place], color="#cccccc", linewidth=3, zorder=1)
        axes.plot([nominal], [place], "o", color=colour, markersize=10, zorder=3)
        hollow = {"color": colour, "markerfacecolor": "white", "markeredgewidth": 1.6}
        axes.plot(others, [place] * len(others), "D", markersize=6, zorder=2, **hollow)
    axes.set_yticks(range(len(models)), [model.name for model in reversed(models)])
    axes.set_xscale("log")
    axes.set_xlim(0.003, 4)
    ticks = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2)
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()
    axes.grid(axis="x", color="#eeeeee")
    axes.set_axisbelow(True)
    axes.set_xlabel("error of a contact in x, y and depth, mm (OSPA; a missed contact counts 3 mm)")
    axes.set_title(
        "Dot: the sensor it was trained on.  Diamonds: four other sensors of the same make.",
        fontsize=10,
        loc="left",
    )
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
    axes.tick_params(axis="y", length=0)
    figure.savefig(path, dpi=150, metadata={"Software": None})


def page_with(text: str, lines: list[str]) -> str:
    """Return the page with the table between its marks. Raises ValueError without marks."""
    begin, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    return text[:begin] + "\n\n" + "\n".join(lines) + "\n\n" + text[end:]


@click.command()
@click.option("--check", is_flag=True, help="Write nothing; exit 1 when the table is out of date.")
@click.pass_context
def main(ctx: click.Context, check: bool) -> None:
    """Draw the README's picture and write its table."""
    say: Callable[[str], None] = click.echo
    models = read_models()
    text = PAGE.read_text(encoding="utf-8")
    wanted = page_with(text, list(table_lines(models)))
    if check:
        say("the table is what the records give" if wanted == text else "the table is out of date")
        ctx.exit(wanted != text)
    PAGE.write_text(wanted, encoding="utf-8")
    draw(models, PICTURE)
    say(f"wrote the table of {PAGE.name} and {PICTURE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
