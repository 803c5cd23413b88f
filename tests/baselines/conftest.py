"""Building and fitting the baselines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tactibench import Grid, ModelContext
from tactibench.run import NullProgress


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)


@pytest.fixture
def context() -> Callable[[str], ModelContext]:
    return lambda answer: ModelContext(answer, Grid.centred(64, 0.4), 6.0)


@pytest.fixture
def fitted(context: Any) -> Callable[..., Any]:
    def fit(kind: Any, frames: Any, truth: Any, answer: str = "contacts", **parameters: Any) -> Any:
        model = kind(context(answer), **parameters)
        report = model.fit(
            frames,
            truth,
            validation=([], []),
            rng=np.random.default_rng(0),
            progress=NullProgress(),
        )
        assert report.notes == {"frames": len(frames)}
        return model

    return fit
