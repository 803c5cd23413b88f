"""``tactibench doctor``: check this installation, and say what is broken and why."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench.cli.text import echo
from tactibench.errors import UserError, is_full

if TYPE_CHECKING:
    from tactibench.plugins import PluginHost

PACKAGES = ("torch", "numpy", "scipy", "pandas", "opencv-contrib-python-headless")


@dataclass(frozen=True)
class Line:
    """One line of the report: a heading such as "cache", a text, and whether all is well."""

    heading: str
    text: str
    ok: bool = True


@click.command()
@click.option("--data", type=click.Path(path_type=Path), help="Also check a folder of frames.")
@click.pass_context
def doctor(ctx: click.Context, data: Path | None) -> None:
    """Check packages, cache, plugins and protocols. Exit code 1 when something is wrong."""
    problems = 0
    for line in _check_all(data):
        problems += not line.ok
        echo(f"{line.heading if line.ok else 'broken':<10}{line.text}")
    if problems:
        echo(f"{problems} problem{'s' if problems > 1 else ''} found")
        ctx.exit(1)
    echo("all is well")


def _check_all(data: Path | None) -> Iterator[Line]:
    from tactibench.plugins import PluginHost

    host = PluginHost()
    yield from _check_machine()
    yield from _check_packages()
    yield _check_cache()
    yield from _check_plugins(host)
    yield from _check_targets(host)
    yield from _check_protocols()
    if data is not None:
        yield _check_folder(data, host)


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


def _check_folder(data: Path, host: PluginHost) -> Line:
    import numpy as np

    from tactibench.plugins import SensorContext

    try:
        sensor = host.sensors["recorded"].load()(SensorContext(np.random.SeedSequence(0), data))
    except UserError as error:
        return Line("data", str(error), ok=False)
    facts = sensor.describe()
    shape, unit = (
        (facts["signal"], "channels") if sensor.signal == "channels" else (facts["image"], "px")
    )
    size = f"{'x'.join(map(str, shape))} {unit}"
    return Line("data", f"{data}: {facts['count']:,} frames of {size}: ok")
