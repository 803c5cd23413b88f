#!/usr/bin/env python
"""Execute the cells of docs/api.ipynb in a folder, and keep what the last line of each shows.

python scripts/run_notebook.py FOLDER            # executes the cells there and writes the outputs
python scripts/run_notebook.py FOLDER --check    # exit code 1 where one shows something else

A cell with the tag "varies" shows times or the name of a run, and is not compared.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import click

NOTEBOOK = Path(__file__).resolve().parents[1] / "docs" / "api.ipynb"


def program(cells: list[str]) -> str:
    """Return a program that executes the cells and prints what a notebook shows of each, as JSON.

    Args:
        cells: Code of the cells.
    """
    lines = ["import json as _json", "_shown = []"]
    for source in cells:
        cell = ast.parse(source).body
        last = cell.pop() if isinstance(cell[-1], ast.Expr) else ast.parse("None").body[0]
        lines += [ast.unparse(line) for line in cell]
        lines.append(f"_shown.append(repr({ast.unparse(last)}))")
    return "\n".join([*lines, "print(_json.dumps(_shown))"])


@click.command()
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False, exists=True))
@click.option("--check", is_flag=True, help="Write nothing; compare.")
@click.pass_context
def main(ctx: click.Context, folder: Path, check: bool) -> None:
    """Execute the cells of docs/api.ipynb in FOLDER."""
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    text = program(["".join(cell["source"]) for cell in cells])
    command = [sys.executable, *(f"-W{option}" for option in sys.warnoptions), "-c", text]
    done = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True)
    for number, (cell, found) in enumerate(zip(cells, json.loads(done.stdout), strict=True), 1):
        shown = "" if found == "None" else found
        kept = "".join(line for out in cell["outputs"] for line in out["data"]["text/plain"])
        if check and shown != kept and "varies" not in cell["metadata"].get("tags", []):
            click.echo(f"cell {number} shows\n{shown}\nand the notebook has\n{kept}")
            ctx.exit(1)
        data = {"text/plain": shown.splitlines(keepends=True)}
        result = {"data": data, "execution_count": number, "metadata": {}}
        cell["outputs"] = [{**result, "output_type": "execute_result"}] if shown else []
        cell["execution_count"] = number
    if not check:
        NOTEBOOK.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", "utf-8")


if __name__ == "__main__":
    main()
