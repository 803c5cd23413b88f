"""NGSolve is an optional extra; it is imported here and nowhere else."""

from __future__ import annotations

from typing import Any

from tactibench import UserError


def require_ngsolve() -> Any:
    """The ngsolve module. Raises UserError where it is not installed."""
    try:
        import ngsolve
    except ImportError:
        raise UserError(
            "the finite-element run needs NGSolve, which is not installed; "
            'run pip install "tactibench[fem]".'
        ) from None
    return ngsolve
