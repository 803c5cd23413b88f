"""The command ``tactibench``: verbs by name, imported when they are called."""

from __future__ import annotations

import sys
from importlib import import_module

import click

from tactibench import __version__
from tactibench.errors import UserError, did_you_mean

VERBS = {
    "describe": ("tactibench.cli.describe:describe", "show one plugin's or protocol's details"),
    "doctor": ("tactibench.cli.doctor:doctor", "check the installation and name broken plugins"),
    "list": ("tactibench.cli.listing:listing", "list models, sensors, encoders and protocols"),
    "run": ("tactibench.cli.run:run", "run a protocol with a model and score it"),
    "score": ("tactibench.cli.score:score", "score stored predictions again"),
}


class Verbs(click.Group):
    """Built-in verbs, then those of plugins."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        return sorted({*VERBS, *_plugin_verbs()})

    def get_command(self, _ctx: click.Context, name: str) -> click.Command | None:
        if name in VERBS:
            module, _, attribute = VERBS[name][0].partition(":")
            command: click.Command = getattr(import_module(module), attribute)
            return command
        verbs = _plugin_verbs()
        if name not in verbs:
            known = self.list_commands(_ctx)
            raise UserError(f"unknown command {name!r}; {did_you_mean(name, known)}")
        loaded: click.Command = verbs[name].load()
        return loaded

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        rows = {name: summary for name, (_, summary) in VERBS.items()}
        rows |= {name: spec.summary for name, spec in _plugin_verbs().items()}
        with formatter.section("Commands"):
            formatter.write_dl(sorted(rows.items()))


def _plugin_verbs():  # type: ignore[no-untyped-def]
    from tactibench.plugins.host import PluginHost

    specs = PluginHost().commands.specs
    return {name: spec for name, spec in specs.items() if name not in VERBS}


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="tactibench")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.pass_context
def main(ctx: click.Context, debug: bool) -> None:
    """Benchmark soft optical tactile sensors: protocols, models, speed beside error.

    \b
    tactibench run exp2 --model unet      the main experiment, on a simulated TacTip
    tactibench list                       what is installed
    """
    ctx.obj = {"debug": debug}


def run() -> None:
    """Entry point of the console script: errors of the user's making become one sentence."""
    debug = "--debug" in sys.argv[1:]
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    sys.exit(call(arguments, debug=debug))


def call(arguments: list[str], *, debug: bool = False) -> int:
    """Run a command line and return its exit code: 0, 2 for a mistake, 130 when interrupted."""
    try:
        result = main.main(args=arguments, prog_name="tactibench", standalone_mode=False)
    except click.exceptions.Abort:
        return _stopped()
    except KeyboardInterrupt:
        return _stopped()
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return 0
    except click.ClickException as error:
        return _failed(f"{error.format_message().rstrip('.')}.")
    except UserError as error:
        if debug:
            raise
        return _failed(str(error))
    except OSError as error:
        if debug:
            raise
        return _failed(_about_files(error))
    return int(result) if isinstance(result, int) else 0


def _failed(sentence: str) -> int:
    click.echo(f"tactibench: {sentence}", err=True)
    return 2


def _stopped() -> int:
    click.echo("tactibench: stopped; the same command continues where it was.", err=True)
    return 130


def _about_files(error: OSError) -> str:
    import errno

    where = f" while writing {error.filename}" if error.filename else ""
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return (
            f"the disk is full{where}; free some space, or put the store elsewhere with --out and "
            "the cache with TACTIBENCH_CACHE, then run the same command again."
        )
    what = error.strerror or str(error)
    place = f" {error.filename}" if error.filename else ""
    return f"the file system refused{place}: {what}; check the path and its permissions."
