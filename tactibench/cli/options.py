"""What all verbs share: options, completion of names, and errors as one sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from tactibench.errors import UserError, did_you_mean, is_full, printable
from tactibench.shipped import OWN_BOARD, default_board

if TYPE_CHECKING:
    from tactibench.run import RunRequest

Verb = Callable[..., Any]


def output_file(
    *names: str, suffixes: tuple[str, ...] = (), **attributes: Any
) -> Callable[[Verb], Verb]:
    """Return an option that names a file to write.

    What could not be written after the work is refused before it: a folder that is not there, and
    a name that ends in none of the suffixes, the first of which is proposed.
    """

    def check(_ctx: click.Context, _option: click.Parameter, path: Path | None) -> Path | None:
        if path is None:
            return None
        if suffixes and path.suffix.lower() not in suffixes:
            kind = suffixes[0][1:].upper()
            raise click.BadParameter(
                f"{path.name} is no {kind} file; call it {path.stem}{suffixes[0]}."
            )
        if not path.parent.is_dir():
            raise click.BadParameter(f"the folder {path.parent} is not there; make it first.")
        return path

    file = click.Path(path_type=Path, dir_okay=False, writable=True)
    return click.option(*names, type=file, callback=check, **attributes)


def param_option(
    metavar: str = "KIND.NAME=VALUE", help_text: str = "Set a parameter."
) -> Callable[[Verb], Verb]:
    """Return the option that sets a parameter of a plugin; the verb takes all as ``params``."""
    return click.option("--param", "params", multiple=True, metavar=metavar, help=help_text)


_folder = partial(click.option, type=click.Path(path_type=Path, file_okay=False))
_board = partial(_folder, "--board", "board_folder", help="Folder of the leaderboards.")
store_option = _folder("--store", default="runs", show_default=True, help="The run store.")
board_option = _board(default=default_board, show_default=f"{OWN_BOARD} here, or those that ship")
"""The board that is read."""
own_board_option = _board(default=OWN_BOARD, show_default=True)
"""The board that is written, which is none of those that ship."""
full_option = click.option("--full", is_flag=True, help="Print all tables and published rows.")
runner_option = click.option(
    "--runner",
    metavar="COMMAND",
    help="Starts the process in which the model answers, through a container or another user.",
)
json_option = output_file("--json", "json_file", help="Write the results here, as JSON.")
picture_option = output_file(
    "--out", suffixes=(".png",), metavar="FILE.png", help="Draw the picture."
)


def save_json(path: Path | None, values: Any) -> None:
    """Write values as JSON where ``--json`` names a file."""
    if path is not None:
        from tactibench.records import write_json

        write_json(path, values)


def add_options(*options: Callable[[Verb], Verb]) -> Callable[[Verb], Verb]:
    """Return a decorator that adds several options, which ``--help`` lists in this order."""

    def decorate(verb: Verb) -> Verb:
        for option in reversed(options):
            verb = option(verb)
        return verb

    return decorate


def _read_seeds(ctx: click.Context, param: click.Parameter, text: str) -> tuple[int, ...]:
    """Return the seeds of "0,1,2", each once."""
    words = [word.strip() for word in text.split(",")]
    if not all(word.isdecimal() for word in words):
        raise click.BadParameter(f"{text!r} is no list of seeds; write 0 or 0,1,2.", ctx, param)
    return tuple(dict.fromkeys(map(int, words)))


def request_options(
    *,
    regime: str = "Frames handed to training; default: the protocol's first.",
    encoder: str = "Encoder, for models that use one.",
    seed: str | None = None,
    seeds: str | None = None,
) -> Callable[[Verb], Verb]:
    """Add what a request asks of frames, weights and machine; the arguments are help texts.

    The verb takes the values as ``**options`` and hands them to ``request_of``. With ``seeds`` it
    takes several seeds, as ``seeds``, in place of one.
    """
    shown: dict[str, Any] = {"default": "0", "show_default": True}
    one = click.option("--seed", type=click.IntRange(min=0), help=seed, **shown)
    many = click.option("--seeds", "--seed", callback=_read_seeds, help=seeds, **shown)
    return add_options(
        click.option("--regime", help=regime),
        click.option(
            "--sensor", type=SENSOR, help="Sensor that makes the frames; default: the protocol's."
        ),
        click.option("--encoder", type=ENCODER, help=encoder),
        click.option("--data", type=click.Path(path_type=Path), help="Folder of recorded frames."),
        many if seeds else one,
        click.option(
            "--device",
            type=click.Choice(["auto", "cpu", "cuda"]),
            default="auto",
            show_default=True,
        ),
        param_option(),
    )


def request_of(protocol: str, model: str, options: Mapping[str, Any], **more: Any) -> RunRequest:
    """Return the request of a verb with ``request_options``; more: further fields of it.

    Raises UserError for a ``--param`` that is not understood.
    """
    from tactibench.run import RunRequest, read_parameters

    fields = dict(options)
    return RunRequest(
        protocol, model, parameters=read_parameters(fields.pop("params")), **fields, **more
    )


Names = Callable[[click.Context], Iterable[str]]


class Name(click.types.StringParamType):
    """A name that a shell may complete; whether it exists is asked where it is used."""

    def __init__(self, names: Names) -> None:
        self._names = names

    def shell_complete(
        self, ctx: click.Context, _param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the names that begin with what was typed."""
        return [CompletionItem(name) for name in self._names(ctx) if name.startswith(incomplete)]


class OneOf(click.Choice[str]):
    """One of a few words; another one is answered by the word that is meant, or by all."""

    def get_invalid_choice_message(self, value: Any, ctx: click.Context | None) -> str:  # noqa: ARG002
        """Return what is wrong with a word."""
        return f"there is no {str(value)!r}; {did_you_mean(str(value), self.choices)}"


def _plugins(kind: str) -> Names:
    def names(_ctx: click.Context) -> Iterable[str]:
        from tactibench.plugins import PluginHost

        return sorted(getattr(PluginHost(), kind).specs)

    return names


def _protocols(_ctx: click.Context) -> Iterable[str]:
    from tactibench.protocols import protocol_files

    return sorted(protocol_files())


def _runs(ctx: click.Context) -> Iterable[str]:
    from tactibench.records import run_names

    store = Path(ctx.params.get("store") or "runs")
    return sorted(run_names(store)) if store.is_dir() else ()


MODEL = Name(_plugins("models"))
SENSOR = Name(_plugins("sensors"))
ENCODER = Name(_plugins("encoders"))
PROTOCOL = Name(_protocols)
RUN = Name(_runs)


def echo(text: str, *, err: bool = False) -> None:
    """Print lines, control characters in them escaped."""
    click.echo(printable(text, keep="\n\t"), err=err)


def sentence(error: BaseException) -> str | None:
    """Return what went wrong and what to do, on one line that ends like a sentence.

    None: it is neither a mistake of the user's nor an exception of a plugin.
    """
    if isinstance(error, OSError):
        text = _about_files(error)
    elif isinstance(error, click.ClickException):
        text = error.format_message()
    elif isinstance(error, UserError):
        text = str(error)
    else:
        from tactibench.plugins import describe_failure

        return describe_failure(error)
    text = printable(" ".join(text.split()))
    if isinstance(error, click.UsageError) and error.ctx and not text.endswith(("?", ")")):
        text = f"{text.rstrip('.')}; see `{error.ctx.command_path} --help`."
    return text if text.endswith((".", "?", ")")) else f"{text}."


def _about_files(error: OSError) -> str:
    place = f" {error.filename}" if error.filename else ""
    if is_full(error):
        where = f" while writing{place}" if place else ""
        return f"the disk is full{where}; free some space, then run the same command again."
    from tactibench.plugins import Owners

    what = error.strerror or str(error) or type(error).__name__
    at = Owners().place_of_error(error)
    source = "" if at is None else f" (plugin {at.origin} asked in {at})"
    return (
        f"the file system refused{place}{source}: {what}; check the path, its permissions and "
        "limits."
    )
