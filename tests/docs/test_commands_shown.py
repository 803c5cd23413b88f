"""Every `tactibench` command in a page can be typed: verb, options, choices, parameters exist."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from tactibench.cli.main import main
from tactibench.errors import UserError
from tactibench.plugins import PluginHost
from tactibench.protocols import protocol_files

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    path
    for path in [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md"), *ROOT.glob("leaderboards/*.md")]
    if path.name != "CHANGELOG.md" and path.parent.name != "reference"
)
OWN = {"mine", "ridge", "box", "bump"}
"""Names that a reader gives to plugins of his own."""
OF_OWN = {"size", "penalty"}
"""Parameters of the model that `tactibench new model` writes."""
HOST = PluginHost()


def commands(text: str) -> Iterator[str]:
    """Lines of fenced and indented code that begin with the program, without comments."""
    code = [
        *re.findall(r"^```(?:sh|console)\n(.*?)^```", text, re.M | re.S),
        *re.findall(r"^    (tactibench .*)$", text, re.M),
    ]
    for line in "\n".join(code).splitlines():
        for part in line.removeprefix("$ ").split(" && "):
            if part.startswith("tactibench "):
                yield re.sub(r"\s+#.*|,$", "", part)


def shown() -> list[tuple[str, str]]:
    found = [
        (page.relative_to(ROOT).as_posix(), one)
        for page in PAGES
        for one in dict.fromkeys(commands(page.read_text(encoding="utf-8")))
    ]
    assert len(found) > 60
    return found


def parsed(words: list[str]) -> tuple[str, dict[str, object]]:
    """The verb's path and what its parser took. Raises click's errors and UserError."""
    command: click.Command = main
    # With its own settings: click keeps the help option that it makes first.
    context = click.Context(main, info_name="tactibench", **main.context_settings)
    while isinstance(command, click.Group):
        name = words.pop(0)
        inner = command.get_command(context, name)
        if inner is None:
            raise UserError(f"no verb {name!r}")
        command, context = inner, click.Context(inner, info_name=name, parent=context)
    options, rest, _ = command.make_parser(context).parse_args(list(words))
    needed = [p for p in command.params if isinstance(p, click.Argument) and p.required]
    given = [options.get(p.name or "") for p in needed]
    assert rest == []
    alone = any(p.is_eager and options.get(p.name or "") for p in command.params)  # `--params`
    assert alone or all(isinstance(v, str | tuple) and v for v in given), "one is missing"
    for option in command.params:
        value = options.get(option.name or "")
        if isinstance(option.type, click.Choice | click.IntRange) and isinstance(value, str):
            option.type.convert(value, option, context)
    if isinstance(options.get("models"), str):  # `run` takes several
        options["model"] = options.pop("models")
    return context.command_path, options


def check_names(options: dict[str, object]) -> None:
    """Model, sensor, encoder, protocol and their parameters are known. Raises UserError."""
    protocol = options.get("protocol")
    if isinstance(protocol, str) and re.fullmatch(r"[a-z0-9]+", protocol):
        examples = (ROOT / "docs" / "examples" / "protocols").glob("*.toml")
        assert protocol in {*protocol_files(), *(path.stem for path in examples)}, protocol
    named = {}
    for kind, catalogue in zip(("model", "sensor", "encoder"), HOST.catalogues, strict=True):
        name = options.get(kind)
        if isinstance(name, str) and name not in OWN and not re.search(r",|\.zip$", name):
            named[kind] = catalogue[name]
    named.setdefault("sensor", HOST.sensors["tactip-127"])
    for text in [*_texts(options.get("params")), *_texts(options.get("tests"))]:
        kind, dot, setting = text.partition(".")
        name, _, value = setting.partition("=")
        if dot and kind in named and value != "VALUE" and value not in "ANP":
            named[kind].settings({name: value})


def _texts(value: object) -> list[str]:
    return [str(one) for one in value] if isinstance(value, list | tuple) else []


@pytest.mark.parametrize(("page", "command"), shown())
def test_the_command_can_be_typed(page: str, command: str) -> None:
    _, options = parsed(shlex.split(command)[1:])
    if not {"ridge", "mine"} & {str(options.get("model")), str(options.get("name"))}:
        check_names(options)
    for text in _texts(options.get("params")):
        if options.get("model") == "ridge":
            assert text.partition(".")[2].partition("=")[0] in {*OF_OWN, "epochs"}


@pytest.mark.parametrize(
    "command",
    [
        "tactibench runn exp1",
        "tactibench run exp1 --modell x",
        "tactibench run --model cnn",
        "tactibench run exp9 --model cnn",
        "tactibench run exp1 --model cnnn",
        "tactibench run exp1 --model cnn --param model.widht=3",
        "tactibench score a b c",
        "tactibench run exp1 --model cnn --device tpu",
    ],
)
def test_what_cannot_be_typed_is_found(command: str) -> None:
    with pytest.raises((UserError, click.ClickException, AssertionError)):
        check_names(parsed(shlex.split(command)[1:])[1])


def test_every_model_and_encoder_is_described() -> None:
    text = (ROOT / "docs" / "models.md").read_text(encoding="utf-8")
    shipped = [catalogue.origins for catalogue in (HOST.models, HOST.encoders)]
    names = [n for origins in shipped for n, o in origins.items() if o.distribution == "tactibench"]
    assert [name for name in names if f"`{name}`" not in text] == []


def test_every_simulated_sensor_is_described() -> None:
    text = (ROOT / "docs" / "simulator.md").read_text(encoding="utf-8")
    names = [
        s.name
        for s in HOST.sensors
        if s.origin == "simulated"
        and not s.reference_of
        and HOST.sensors.origins[s.name].plugin == "sim"
    ]
    assert [name for name in names if f"`{name}`" not in text] == []
