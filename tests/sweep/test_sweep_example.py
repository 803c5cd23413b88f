"""The worked example and the keys in the documentation."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from tactibench.plugins import PluginHost
from tactibench.protocols import load_protocol
from tactibench.run import resolve_components
from tactibench.sweep import SweepSpec, list_cells, read_sweep

DOCS = Path(__file__).parents[2] / "docs"


def test_every_cell_of_the_example_can_be_run() -> None:
    host = PluginHost()
    cells = list_cells(read_sweep(DOCS / "examples/sweep.toml"), host)
    for cell in cells:
        parts = resolve_components(cell.request, load_protocol(cell.request.protocol).spec, host)
        assert parts.model.name == cell.request.model
    shown = {cell.axes["model"] for cell in cells}
    assert shown == {"superpose", "mixture", "vgnn", "unet", "unet, mixing=1", "cnn"}
    # superpose 3x2; mixture, vgnn 3x2x3; unet 3x2x2x3, mixed 3x2x3; cnn 3 (each with 3 seeds)
    assert len(cells) == 6 + 2 * 18 + 36 + 18 + 3


def test_the_documentation_names_every_key_and_its_examples_are_valid() -> None:
    text = (DOCS / "cluster.md").read_text(encoding="utf-8")
    for key in SweepSpec.model_fields:
        assert re.search(rf"`(\[\[)?{key}(\]\])?`|^{key} =|or {key} =", text, re.MULTILINE), key
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 1
    for block in blocks:
        SweepSpec.model_validate(tomllib.loads(block))
