"""``tactibench doctor``: what works here, what does not, and why."""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import click


@click.command()
@click.option("--data", type=click.Path(path_type=Path), help="Also check a folder of frames.")
def doctor(data: Path | None) -> None:
    """Check dependencies, plugins, the cache and this machine. Exit code 1 when something is wrong."""
    from tactibench.plugins.host import PluginHost
    from tactibench.records.cache import cache_folder
    from tactibench.timing.fingerprint import fingerprint, fingerprint_hash

    bad = 0
    found = fingerprint(with_torch=True)
    click.echo(f"machine   {found['cpu']}, {found['cores_logical']} cores, {found['memory_gib']} GiB")
    gpu = ", ".join(found["gpu"]) if found["gpu"] else "none"
    click.echo(f"          GPU {gpu}; fingerprint {fingerprint_hash(found)}")
    for package in ("torch", "numpy", "scipy", "pandas", "opencv-contrib-python-headless"):
        try:
            click.echo(f"package   {package} {version(package)}")
        except PackageNotFoundError:
            bad += 1
            click.echo(f"package   {package} is not installed; pip install tactibench")
    cache = cache_folder()
    problem = _unwritable(cache)
    bad += problem is not None
    click.echo(f"cache     {cache}{f': {problem}' if problem else ''}")
    host = PluginHost()
    for origin in host.plugins:
        click.echo(f"plugin    {origin.plugin} ({origin.distribution} {origin.version}): ok")
    for kind in ("models", "sensors", "encoders"):
        for spec in getattr(host, kind):
            module = spec.target.partition(":")[0]
            try:
                spec.load()
            except Exception as error:  # noqa: BLE001 - a stranger's code may raise anything
                bad += 1
                text = str(error).splitlines()[0] if str(error) else ""
                click.echo(
                    f"broken    {kind[:-1]} {spec.name}: {module} does not load: "
                    f"{type(error).__name__}: {text}"
                )
    for trouble in host.problems:
        bad += 1
        origin = trouble.origin
        click.echo(
            f"broken    plugin {origin.plugin} ({origin.distribution} {origin.version}) "
            f"in step {trouble.step}: {trouble.message}"
        )
    bad += _protocols()
    if data is not None:
        _folder(data, host)
    click.echo("all is well" if not bad else f"{bad} problem{'s' if bad > 1 else ''} found")
    if bad:
        raise SystemExit(1)


def _protocols() -> int:
    from tactibench.errors import UserError
    from tactibench.protocols.loader import protocol_files, read_protocol

    bad = 0
    for path in protocol_files().values():
        try:
            loaded = read_protocol(path)
            click.echo(f"protocol  {loaded.label}: ok")
        except UserError as error:
            bad += 1
            click.echo(f"broken    {error}")
    return bad


def _folder(data: Path, host: object) -> None:
    numpy = import_module("numpy")
    from tactibench.plugins.interfaces import SensorContext
    from tactibench.running.parts import data_folder

    spec = host.sensors["recorded"]  # type: ignore[attr-defined]
    sensor = spec.load()(SensorContext(numpy.random.SeedSequence(0), data_folder(data)))
    facts = sensor.describe()
    click.echo(f"data      {facts['folder']}: {facts['count']:,} frames of {facts['image']} px: ok")


def _unwritable(folder: Path) -> str | None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".probe"
        probe.write_bytes(b"")
        probe.unlink()
    except OSError as error:
        return f"cannot be written ({error.strerror}); set TACTIBENCH_CACHE"
    return None
