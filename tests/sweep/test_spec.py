"""The cells that a sweep's file asks for, and every mistake in it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tactibench.errors import UserError
from tactibench.plugins import PluginHost
from tactibench.sweep import Cell, list_cells, read_choice, read_sweep

GOOD = 'model = "toy"\n'


@pytest.fixture
def cells(asked: Callable[[str], Path]) -> Callable[[str], tuple[Cell, ...]]:
    return lambda text: list_cells(read_sweep(asked(text)), PluginHost())


def test_every_combination_in_the_order_of_the_lists(
    cells: Callable[..., tuple[Cell, ...]],
) -> None:
    found = cells('model = ["toy", "mean"]\nregime = ["single", "multiple"]\nseed = [0, 2]')
    assert len(found) == 2 * 2 * 2 * 2
    first, second, third = (cell.request for cell in found[:3])
    assert Path(first.protocol).name == "few-exp1.toml"
    assert (first.model, first.regime, first.sensor, first.seed) == ("toy", "single", "toy", 0)
    assert (second.seed, third.regime, third.encoder) == (2, "multiple", None)
    assert found[-1].label == "protocols/few-exp2.toml mean multiple toy seed 2"
    assert {cell.request.device for cell in found} == {"cpu"}


def test_settings_of_one_plugin_come_before_those_of_all(
    cells: Callable[..., tuple[Cell, ...]],
) -> None:
    found = cells(
        'model = ["toy", "toy, noise = 2.5"]\nparams = ["model.noise=1"]\nquick = true\nlimit = 3'
    )
    assert [cell.request.parameters for cell in found[:2]] == [
        {"model": {"noise": "1"}},
        {"model": {"noise": "2.5"}},
    ]
    assert found[0].request.quick
    assert found[0].request.limit == 3


def test_an_encoder_is_for_models_that_learn_its_maps(
    cells: Callable[..., tuple[Cell, ...]],
) -> None:
    found = cells(
        'protocol = "exp1"\nmodel = ["mean", "unet", "mixture"]\nencoder = ["hertz", "offset"]\n'
        'params = ["encoder.threshold=0.2"]'
    )
    shown = [(cell.request.model, cell.request.encoder) for cell in found]
    assert shown == [("mean", None), ("unet", "hertz"), ("unet", "offset"), ("mixture", None)]
    assert "encoder" not in found[0].request.parameters
    assert found[1].request.parameters["encoder"] == {"threshold": "0.2"}


def test_exclusions(cells: Callable[..., tuple[Cell, ...]]) -> None:
    text = """
        model = ["toy", "toy, noise=1"]
        seed = [0, 1, 2]
        [[exclude]]
        model = "toy, noise=1"
        seed = [1, 2]
        [[exclude]]
        protocol = "protocols/few-exp2.toml"
    """
    found = [(cell.axes["model"], cell.request.seed) for cell in cells(text)]
    assert found == [("toy", 0), ("toy", 1), ("toy", 2), ("toy, noise=1", 0)]


def test_names_with_settings() -> None:
    assert read_choice("unet").parameters == {}
    assert read_choice(" unet , width = 8,depth=2").parameters == {"width": "8", "depth": "2"}
    for text, says in (("unet, width", "write NAME, KEY=VALUE"), ("u, a=1, a=2", "sets a twice")):
        with pytest.raises(UserError, match=says):
            read_choice(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("modell = 'toy'", "unknown key 'modell'.*did you mean 'model'"),
        ("model = 'toy'\n[[exclude]]\nmodl = 'toy'", "unknown key 'exclude.1.modl'.*'model'"),
        ("model = 'toy'\nseed = -1", "'seed.1' is -1"),
        ("model = 'toy'\ndevice = 'gpu'", "'cpu' or 'cuda'"),
        ("model = 'tou'", "unknown model 'tou'; did you mean 'toy'"),
        ("model = 'toy, nois=1'", "no parameter 'nois'"),
        ("model = 'toy'\nprotocol = 'exp9'", "unknown protocol 'exp9'"),
        ("model = 'toy'\nparams = ['noise=1']", "'noise=1' is not understood"),
        ("model = 'toy'\ntest = ['refrence']", "'refrence' is neither"),
        ("model = 'toy'\n[[exclude]]\nmodel = 'unet'", "'exclude.1' leaves out no cell"),
        ("model = 'toy'\n[[exclude]]\nmodel = 'toy'", "the exclusions leave no cell"),
    ],
)
def test_mistakes(cells: Callable[[str], object], text: str, says: str) -> None:
    with pytest.raises(UserError, match=says) as caught:
        cells(text)
    assert str(caught.value).startswith("sweep file ")


def test_a_file_of_several_sweeps_asks_for_every_run_once(
    cells: Callable[..., tuple[Cell, ...]],
) -> None:
    text = """
        [[sweep]]
        protocol = "exp1"
        model = ["nearest", "mean"]

        [[sweep]]
        protocol = ["exp1", "exp1@3"]
        model = "nearest"
        seed = [0, 1]
    """
    asked = [
        (c.request.protocol, c.request.model, c.request.seed)
        for c in cells(text.replace("    ", ""))
    ]
    assert asked == [
        ("exp1", "nearest", 0),
        ("exp1", "mean", 0),
        ("exp1", "nearest", 1),
        ("exp1@3", "nearest", 0),
        ("exp1@3", "nearest", 1),
    ]


def test_a_mistake_in_one_of_several_sweeps(cells: Callable[..., tuple[Cell, ...]]) -> None:
    text = '[[sweep]]\nprotocol = "exp1"\nmodel = "mean"\n'
    with pytest.raises(UserError, match="sweep 2: unknown model 'x'"):
        cells(f"{text}{text.replace('mean', 'x')}")
