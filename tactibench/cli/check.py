"""``tactibench check``: check that a plugin behaves as every one of its kind must."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import json_option, param_option, save_json
from tactibench.cli.text import echo
from tactibench.errors import UserError, did_you_mean
from tactibench.plugins import KINDS

if TYPE_CHECKING:
    from tactibench.plugins import PluginHost
    from tactibench.testing import Finding, Report


@click.command()
@click.argument("name")
@click.option("--kind", type=click.Choice(KINDS), help="Where several kinds have that name.")
@click.option("--sensor", default="", help="Presses the frames of a model; default: tactip-127.")
@click.option("--encoder", default="", help="What a model is trained through.")
@click.option(
    "--data",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Folder of a sensor that reads recorded frames.",
)
@param_option()
@click.option(
    "--expect-failed",
    "expected",
    multiple=True,
    metavar="PROPERTY=REASON",
    help="A property that does not hold, and why; it is an error if it holds.",
)
@json_option
@click.pass_context
def check(
    ctx: click.Context,
    /,
    name: str,
    kind: str | None,
    params: tuple[str, ...],
    expected: tuple[str, ...],
    json_file: Path | None,
    **options: Any,
) -> None:
    """Check that the model, sensor or encoder called NAME behaves as every one of its kind must.

    One line a property: what it asserts and, where it does not hold, what was found. Models are
    trained on 40 frames. Exit code 1 when a property fails, or when nothing ran.
    """
    from tactibench.plugins import PluginHost
    from tactibench.run import read_parameters
    from tactibench.testing import (
        check_names,
        expected_failures,
        properties,
        run_checks,
        subject_of,
    )

    host, given, reasons = PluginHost(), read_parameters(params), _reasons(expected)
    subjects = {
        subject_kind: subject_of(subject_kind, name, parameters=given, host=host, **options)
        for subject_kind in ([kind] if kind else _kinds_of(name, host))
    }
    for subject_kind in subjects:
        check_names(properties(subject_kind), reasons)
    reports = []
    for subject_kind, subject in subjects.items():
        echo(f"{subject.title}:")
        expectations = expected_failures(subject, reasons)
        report = run_checks(properties(subject_kind), subject, expectations, _print_finding)
        echo(report.summary())
        reports.append(report)
    save_json(json_file, _json_values(reports))
    if not all(report.ok for report in reports):
        ctx.exit(1)


def _print_finding(finding: Finding) -> None:
    echo(f"  {finding.line()}")


def _kinds_of(name: str, host: PluginHost) -> list[str]:
    """Return the kinds that have something of that name. Raises UserError for none."""
    kinds = [catalogue.kind for catalogue in host.catalogues if name in catalogue]
    if not kinds:
        known = {spec.name for catalogue in host.catalogues for spec in catalogue}
        broken = "; `tactibench doctor` names plugins that do not load" if host.problems else ""
        raise UserError(
            f"no model, sensor or encoder is called {name!r}{broken}; {did_you_mean(name, known)}"
        )
    return kinds


def _reasons(texts: tuple[str, ...]) -> dict[str, str]:
    """Return property -> reason of ``("nan_frame=looks at no frame",)``. Raises UserError."""
    reasons = {}
    for text in texts:
        name, equals, reason = text.partition("=")
        if not equals:
            raise UserError(
                f"--expect-failed {text!r} is not understood; write PROPERTY=REASON, for example "
                "--expect-failed 'nan_frame=looks at no frame'."
            )
        reasons[name] = reason
    return reasons


def _json_values(reports: list[Report]) -> dict[str, Any]:
    return {
        "metrics": [row for report in reports for row in report.rows()],
        "properties": [
            {
                "subject": report.title,
                "property": finding.checked.name,
                "asserts": finding.checked.statement,
                "outcome": finding.outcome,
                "found": finding.message,
                "seconds": round(finding.seconds, 3),
            }
            for report in reports
            for finding in report.findings
        ],
    }
