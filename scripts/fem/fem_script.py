"""Arguments and output of the scripts: progress on stderr, mistakes as one sentence."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt
from elements import NotConvergedError, require_ngsolve

from tactibench import UserError
from tactibench.lab import atomic
from tactibench_sim import digest_of


def solver() -> str:
    """Return name and version of the solver.

    Raises:
        UserError: NGSolve is not installed.
    """
    return f"ngsolve {require_ngsolve().__version__}"


def report_progress(step: str) -> None:
    """Print the name of the next step of a computation."""
    click.echo(f"{step} ...", err=True)


def output_file(text: str) -> Path:
    """Return the path of a file to be written.

    Raises:
        ArgumentTypeError: The file's folder does not exist.
    """
    path = Path(text)
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"the folder {path.parent} is not there; make it first")
    return path


def number(low: float, high: float = math.inf) -> Callable[[str], float]:
    """Return a function that reads a number from ``low`` to ``high``; it refuses NaN."""

    def read(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not in the range {low:g} to {high:g}")
        return value

    return read


def write_tables(
    path: Path, arrays: Mapping[str, npt.NDArray[Any]], parameters: dict[str, Any]
) -> str:
    """Write a file of tables whole or not at all, and return its digest."""
    text = json.dumps(parameters, sort_keys=True)
    digest = digest_of(arrays, text)
    content: dict[str, Any] = {**arrays, "parameters": np.array(text), "sha256": digest}
    with atomic(path) as out:
        np.savez_compressed(out, **content)
    return digest


def write_file(out: Path, make: Callable[[], str]) -> None:
    """Write a file and print its digest; exit with one sentence where that fails.

    Args:
        out: Path of the file.
        make: Function that writes the file and returns its digest.
    """
    try:
        digest = make()
    except NotConvergedError as error:
        sys.exit(f"no file was written: {error}.")
    except UserError as error:
        sys.exit(str(error))
    click.echo(f"{out}  sha256 {digest}")
