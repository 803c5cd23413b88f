"""A CNN as small as it gets."""

import pytest
from drawn_presses import fit

from tactibench import Grid, ModelContext


@pytest.fixture(scope="session")
def make_cnn():
    from tactibench_cnn import CNN

    def _make(answer="contacts", **parameters):
        context = ModelContext(answer, Grid.centred(64, 0.4), 6.0)
        return CNN(context, **{"width": 8, "size": 64, "epochs": 2} | parameters)

    return _make


@pytest.fixture(scope="session")
def trained(make_cnn):
    model = make_cnn()
    fit(model)
    return model
