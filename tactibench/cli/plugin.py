"""``tactibench new``, ``check`` and ``doctor``: begin a plugin, prove it, find what is broken."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tactibench.cli.options import OneOf, echo, json_option, param_option, save_json
from tactibench.errors import UserError, did_you_mean, is_full
from tactibench.plugins import ANSWERS, KINDS

if TYPE_CHECKING:
    from tactibench.plugins import PluginHost
    from tactibench.testing import Report

LIBRARIES = ("numpy", "torch")
EXAMPLES = {
    "model": "tactibench run exp1 --model {name} --quick",
    "sensor": "tactibench run exp1 --model nearest --sensor {name} --quick",
    "encoder": "tactibench run exp1 --model unet --encoder {name} --quick",
}


@click.command()
@click.argument("kind", type=OneOf(KINDS))
@click.argument("name")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path(),
    help="Where to make the package's folder; default: here.",
)
@click.option(
    "--with",
    "library",
    type=OneOf(LIBRARIES),
    default=LIBRARIES[0],
    show_default=True,
    help="What a model is made with.",
)
@click.option("--channels", is_flag=True, help="A sensor that gives numbers and no pictures.")
def new(kind: str, name: str, out: Path, library: str, channels: bool) -> None:
    """Write an installable package with a small, working model, sensor or encoder called NAME.

    The folder is called tactibench-NAME. Nothing that is there already is changed.
    """
    from tactibench.plugins import PluginHost
    from tactibench.scaffold import check_name, write_package

    if channels and kind != "sensor":
        raise click.UsageError(f"--channels is for a sensor, not for {kind!r}; leave it out.")
    if library != LIBRARIES[0] and kind != "model":
        raise click.UsageError(f"--with {library} is for a model, not for {kind!r}; leave it out.")
    names = check_name(kind, name, PluginHost())
    template = "skin" if channels else "" if library == LIBRARIES[0] else library
    folder = write_package(names, out, template)
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        echo(f"wrote {path}")
    place = folder if folder.is_absolute() else f"./{folder}"  # a bare name, pip would look up
    example = EXAMPLES[kind].format(name=name)
    echo("next:")
    for command in (f"pip install -e {place}", f"tactibench check {name}", example):
        echo(f"  {command}")


@click.command()
@click.argument("name")
@click.option("--kind", type=OneOf(KINDS), help="Where several kinds have that name.")
@click.option("--sensor", default="", help="Presses the frames of a model; default: tactip-127.")
@click.option("--encoder", default="", help="What a model is trained through.")
@click.option("--answer", type=OneOf(ANSWERS), help="What a model is asked for.")
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
        report = run_checks(
            properties(subject_kind), subject, expectations, lambda one: echo(f"  {one.line()}")
        )
        echo(report.summary())
        reports.append(report)
    save_json(json_file, _json_values(reports))
    if not all(report.ok for report in reports):
        ctx.exit(1)


def _kinds_of(name: str, host: PluginHost) -> list[str]:
    """Return the kinds that have something of that name. Raises UserError for none."""
    kinds = [catalogue.kind for catalogue in host.catalogues if name in catalogue]
    if not kinds:
        folder = Path(f"tactibench-{name}")
        if folder.is_dir():
            raise UserError(f"{name!r} is not installed yet; run `pip install -e ./{folder}`.")
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
        "properties": [
            {
                "subject": report.title,
                "property": finding.checked.name,
                "asserts": finding.checked.statement,
                "outcome": finding.outcome,
                "found": finding.message,
            }
            for report in reports
            for finding in report.findings
        ],
    }


PACKAGES = ("torch", "numpy", "scipy", "pandas", "opencv-contrib-python-headless")


@dataclass(frozen=True)
class Line:
    """One line of the report: a heading such as "cache", a text, and whether all is well."""

    heading: str
    text: str
    ok: bool = True


@click.command()
@click.pass_context
def doctor(ctx: click.Context) -> None:
    """Check packages, cache, plugins and protocols. Exit code 1 when something is wrong."""
    problems = 0
    for line in _check_all():
        problems += not line.ok
        echo(f"{line.heading if line.ok else 'broken':<10}{line.text}")
    if problems:
        echo(f"{problems} problem{'s' if problems > 1 else ''} found")
        ctx.exit(1)
    echo("all is well")


def _check_all() -> Iterator[Line]:
    from tactibench.plugins import PluginHost

    host = PluginHost()
    yield from _check_machine()
    yield from _check_packages()
    yield _check_cache()
    yield from _check_plugins(host)
    yield from _check_targets(host)
    yield from _check_protocols()


def _check_machine() -> Iterator[Line]:
    from tactibench.run import fingerprint, fingerprint_hash

    try:
        facts = fingerprint(with_torch=True)
    except (ImportError, OSError) as error:  # a torch that is absent or lacks its libraries
        yield Line("machine", f"torch does not load: {error}", ok=False)
        facts = fingerprint()
    gpu = ", ".join(facts["gpu"]) or "none"
    cpu = f"{facts['cpu']}, {facts['cores_logical']} cores, {facts['memory_gib']} GiB"
    yield Line("machine", cpu)
    yield Line("", f"GPU {gpu}; fingerprint {fingerprint_hash(facts)}")


def _check_packages() -> Iterator[Line]:
    for package in PACKAGES:
        try:
            yield Line("package", f"{package} {version(package)}")
        except PackageNotFoundError:
            yield Line("package", f"{package} is not installed; pip install {package}", ok=False)


def _check_cache() -> Line:
    from tactibench.records import VARIABLE, cache_folder

    folder = cache_folder()
    probe = folder / ".probe"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        why = "the disk is full" if is_full(error) else error.strerror
        text = f"{folder} cannot be written ({why}); set {VARIABLE}"
        return Line("cache", text, ok=False)
    return Line("cache", str(folder))


def _check_plugins(host: PluginHost) -> Iterator[Line]:
    from tactibench.cli.main import VERBS

    faulty = {problem.origin for problem in host.problems}
    for origin in host.plugins:
        if origin not in faulty:
            yield Line("plugin", f"{origin}: ok")
    for problem in host.problems:
        text = f"plugin {problem.origin} in step {problem.step}: {problem.message}"
        yield Line("plugin", text, ok=False)
    for name, origin in host.commands.origins.items():
        if name in VERBS:
            text = f"plugin {origin}: its command {name!r} is a built-in verb"
            yield Line("plugin", text, ok=False)


def _check_targets(host: PluginHost) -> Iterator[Line]:
    """Import every class and command behind a spec."""
    for catalogue in (*host.catalogues, host.commands):
        kind = catalogue.kind
        for spec in catalogue:
            plugin = f"plugin {catalogue.origins[spec.name]}"
            try:
                target = spec.load()
            except UserError as error:
                yield Line(kind, f"{plugin}: {kind} {error}", ok=False)
                continue
            if kind == "command" and not isinstance(target, click.Command):
                yield Line(kind, f"{plugin}: {spec.target} is no click command", ok=False)


def _check_protocols() -> Iterator[Line]:
    from tactibench.protocols import protocol_files, read_protocol

    for path in protocol_files().values():
        try:
            yield Line("protocol", f"{read_protocol(path).label}: ok")
        except UserError as error:
            yield Line("protocol", str(error), ok=False)
