"""The command ``tactibench``: verbs by name, imported when they are called."""

from __future__ import annotations

import faulthandler
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from types import FrameType
from typing import TYPE_CHECKING

import click

from tactibench import __version__
from tactibench.cli.options import echo, sentence
from tactibench.errors import UserError, did_you_mean

if TYPE_CHECKING:
    from tactibench.plugins import CommandSpec

VERBS = {
    "board": ("tactibench.cli.board:board", "make the leaderboards; add, submit and verify rows"),
    "check": ("tactibench.cli.plugin:check", "prove that a plugin behaves as its kind must"),
    "compare": ("tactibench.cli.plot:compare", "runs against each other, press by press"),
    "data": ("tactibench.cli.data:data", "data sets on the disk: import, verify, export, info"),
    "demo": ("tactibench.cli.demo:demo", "press a simulated sensor by mouse; see models answer"),
    "describe": ("tactibench.cli.listing:describe", "show one plugin's or protocol's details"),
    "doctor": ("tactibench.cli.plugin:doctor", "check the installation and name broken plugins"),
    "list": ("tactibench.cli.listing:listing", "list plugins, protocols, runs, weights"),
    "new": ("tactibench.cli.plugin:new", "begin a model, sensor or encoder of your own"),
    "plot": ("tactibench.cli.plot:plot", "figures: frontier, curve, stability, limit"),
    "report": ("tactibench.cli.plot:report", "the boards as one HTML page, offline"),
    "run": ("tactibench.cli.run:run", "run a protocol with a model and score it"),
    "score": ("tactibench.cli.run:score", "score stored predictions again"),
    "speed": ("tactibench.cli.speed:speed", "time models in turns"),
    "sweep": ("tactibench.cli.run:sweep", "many runs on all cores, or on a cluster"),
    "weights": ("tactibench.cli.run:weights", "trained weights as a file"),
}
MISTAKE, INTERRUPTED = 2, 130
"""Exit codes: 2 as click and argparse give for a wrong option, 130 as a shell gives for Ctrl-C."""
STOPPED = "tactibench: stopped; the same command continues where it was."


class Verbs(click.Group):
    """Built-in verbs, then those of plugins; a plugin cannot replace a built-in verb."""

    def invoke(self, ctx: click.Context) -> object:
        """Run a verb. An EOFError is a plugin's, and no end of the input, as click takes it."""
        try:
            return super().invoke(ctx)
        except EOFError as error:
            raise UserError(sentence(error) or "the input ended.") from error

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Return the verbs in alphabetical order."""
        return sorted({*VERBS, *_plugin_verbs()})

    def get_command(self, _ctx: click.Context, name: str) -> click.Command | None:
        """Import and return a verb. Raises UserError for an unknown one."""
        if name in VERBS:
            module, _, attribute = VERBS[name][0].partition(":")
            command: click.Command = getattr(import_module(module), attribute)
            return command
        verbs = _plugin_verbs()
        if name not in verbs:
            raise UserError(f"unknown command {name!r}; {did_you_mean(name, {*VERBS, *verbs})}")
        loaded = verbs[name].load()
        if not isinstance(loaded, click.Command):
            raise UserError(
                f"command {name!r} cannot be used, because {verbs[name].target} is no click "
                "command; fix or reinstall its plugin."
            )
        return loaded

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write verbs with their summaries, without importing them."""
        rows = {name: spec.summary for name, spec in _plugin_verbs().items()}
        rows |= {name: summary for name, (_, summary) in VERBS.items()}
        with formatter.section("Commands"):
            formatter.write_dl(sorted(rows.items()))


def _plugin_verbs() -> Mapping[str, CommandSpec]:
    from tactibench.plugins import PluginHost

    return PluginHost().commands.specs


@click.group(
    cls=Verbs,
    context_settings={"help_option_names": ["-h", "--help"]},
    invoke_without_command=True,
)
@click.version_option(__version__, prog_name="tactibench")
@click.option("--debug", is_flag=True, help="Show the traceback of an error (after any verb, too).")
@click.option("--quiet", is_flag=True, help="Show no plan and no progress (after any verb, too).")
@click.pass_context
def main(ctx: click.Context, /, **_options: bool) -> None:
    """Benchmark soft optical tactile sensors: protocols, models, speed beside error.

    \b
    tactibench run exp2 --model unet      the main experiment, on a simulated TacTip
    tactibench list                       what is installed
    """
    if ctx.invoked_subcommand is None:
        echo(ctx.get_help())


def run() -> None:
    """Entry point of the console script."""
    faulthandler.enable()  # a crash in compiled code shows the line of Python that led to it
    os.environ.pop("MPLBACKEND", None)  # that of a notebook may not be installed here
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # else the job ignores it
        signal.signal(signal.SIGINT, _interrupted)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal without "±" is no reason to stop
    try:
        code = call(sys.argv[1:])
    except BrokenPipeError:  # whoever read the output, `head` say, has gone
        code = 1
    try:
        sys.stdout.flush()
    except OSError:  # it was reported; Python's own flush at exit would complain a second time
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if code == INTERRUPTED:
        os._exit(code)  # while Python itself ends, a second Ctrl-C would kill it by its signal
    sys.exit(code)


def _interrupted(_number: int, _frame: FrameType | None) -> None:
    """Ctrl-C: what is open is closed and the command ends; a second one does not wait for that.

    Nothing is lost by it: files take their names when they are whole.
    """
    signal.signal(signal.SIGINT, _at_once)
    raise KeyboardInterrupt


def _at_once(_number: int, _frame: FrameType | None) -> None:
    os.write(2, f"{STOPPED}\n".encode())  # a stream may be in the middle of writing
    os._exit(INTERRUPTED)


def call(arguments: Sequence[str]) -> int:
    """Run a command line and return its exit code.

    0; 1 where a verb says so; 2 after one sentence about a mistake of the user's or of a plugin's;
    130 when interrupted. With ``--debug`` the exception of a mistake is raised instead.
    """
    # What stands after a verb means the same as before it; the terminal asks for --quiet.
    given = [argument for argument in arguments if argument not in ("--debug", "--quiet")]
    if "--quiet" in arguments:
        given.insert(0, "--quiet")
    try:
        result = main.main(args=given, prog_name="tactibench", standalone_mode=False)
        sys.stdout.flush()
    except click.exceptions.NoArgsIsHelpError as error:
        echo(error.format_message())
        return 0
    except click.exceptions.Abort:  # what click makes of Ctrl-C
        echo(STOPPED, err=True)
        return INTERRUPTED
    except BrokenPipeError:
        raise
    except BaseException as error:
        verb = next((argument for argument in given if not argument.startswith("-")), "")
        ended = isinstance(error, SystemExit)
        if ended and verb not in VERBS:
            raise  # a verb of a plugin may end as it likes
        text = sentence(error) if ended or "--debug" not in arguments else None
        if text is None:
            raise
        if "--debug" in arguments:
            raise UserError(text) from error  # Python shows no traceback of a SystemExit
        echo(f"tactibench: {text}", err=True)
        return MISTAKE
    return result if isinstance(result, int) else 0
