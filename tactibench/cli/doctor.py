"""``tactibench doctor``: what works here, what does not, and why."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING

import click

from tactibench.errors import UserError

if TYPE_CHECKING:
    from tactibench.plugins.host import PluginHost

PACKAGES = ("torch", "numpy", "scipy", "pandas", "opencv-contrib-python-headless")

Finding = tuple[bool, str, str]
"""Whether it is well, what was looked at, and what was found."""


@click.command()
@click.option("--data", type=click.Path(path_type=Path), help="Also check a folder of frames.")
@click.pass_context
def doctor(ctx: click.Context, data: Path | None) -> None:
    """Check packages, cache, plugins and protocols. Exit code 1 when something is wrong."""
    from tactibench.plugins.host import PluginHost

    host = PluginHost()
    checks: list[Callable[[], Iterator[Finding]]] = [
        _machine,
        _packages,
        _cache,
        lambda: _plugins(host),
        lambda: _targets(host),
        _protocols,
    ]
    if data is not None:
        checks.append(lambda: _folder(data, host))
    bad = 0
    for check in checks:
        for well, what, found in check():
            bad += not well
            click.echo(f"{what if well else 'broken':<10}{found}")
    click.echo("all is well" if not bad else f"{bad} problem{'s' if bad > 1 else ''} found")
    if bad:
        ctx.exit(1)


def _machine() -> Iterator[Finding]:
    from tactibench.run.machine import fingerprint, fingerprint_hash

    try:
        found = fingerprint(with_torch=True)
    except (ImportError, OSError) as error:  # a torch that is absent or lacks its libraries
        yield False, "machine", f"torch does not load: {error}"
        found = fingerprint()
    gpu = ", ".join(found["gpu"]) or "none"
    yield (
        True,
        "machine",
        f"{found['cpu']}, {found['cores_logical']} cores, {found['memory_gib']} GiB",
    )
    yield True, "", f"GPU {gpu}; fingerprint {fingerprint_hash(found)}"


def _packages() -> Iterator[Finding]:
    for package in PACKAGES:
        try:
            yield True, "package", f"{package} {version(package)}"
        except PackageNotFoundError:
            yield False, "package", f"{package} is not installed; pip install {package}"


def _cache() -> Iterator[Finding]:
    from tactibench.records.cache import VARIABLE, cache_folder

    folder = cache_folder()
    probe = folder / ".probe"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"")
        probe.unlink()
        yield True, "cache", str(folder)
    except OSError as error:
        yield False, "cache", f"{folder} cannot be written ({error.strerror}); set {VARIABLE}"


def _plugins(host: PluginHost) -> Iterator[Finding]:
    from tactibench.cli.main import VERBS

    problems = host.problems
    troubled = {problem.origin for problem in problems}
    for origin in host.plugins:
        if origin not in troubled:
            yield True, "plugin", f"{origin}: ok"
    for problem in problems:
        yield False, "plugin", f"plugin {problem.origin} in step {problem.step}: {problem.message}"
    for name in VERBS:
        if name in host.commands.origins:
            origin = host.commands.origins[name]
            yield False, "plugin", f"plugin {origin}: its command {name!r} is a built-in verb"


def _targets(host: PluginHost) -> Iterator[Finding]:
    for catalogue in (*host.catalogues, host.commands):
        for spec in catalogue:
            try:
                loaded = spec.load()
            except UserError as error:
                origin = catalogue.origins[spec.name]
                yield False, catalogue.kind, f"plugin {origin}: {catalogue.kind} {error}"
                continue
            if catalogue.kind == "command" and not isinstance(loaded, click.Command):
                origin = catalogue.origins[spec.name]
                yield False, "command", f"plugin {origin}: {spec.target} is no click command"


def _protocols() -> Iterator[Finding]:
    from tactibench.protocols.loader import protocol_files, read_protocol

    for path in protocol_files().values():
        try:
            yield True, "protocol", f"{read_protocol(path).label}: ok"
        except UserError as error:
            yield False, "protocol", str(error)


def _folder(data: Path, host: PluginHost) -> Iterator[Finding]:
    import numpy as np

    from tactibench.plugins.base import SensorContext

    try:
        sensor = host.sensors["recorded"].load()(SensorContext(np.random.SeedSequence(0), data))
    except UserError as error:
        yield False, "data", str(error)
        return
    facts = sensor.describe()
    height, width = facts["image"]
    yield True, "data", f"{data}: {facts['count']:,} frames of {height}x{width} px: ok"
