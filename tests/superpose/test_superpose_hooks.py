"""What the plugin declares."""

import inspect

import pytest

from tactibench import UserError


def test_the_model_is_declared(host):
    spec = host.models["superpose"]
    assert spec.max_contacts is None
    assert not spec.uses_encoder
    # The class agrees on every parameter and its default.
    declared = inspect.signature(spec.load()).parameters
    assert spec.settings({}) == {
        name: one.default for name, one in declared.items() if name != "context"
    }


@pytest.mark.parametrize(
    "bad",
    [{"neighbours": "plate"}, {"gain": "1.0"}, {"max_count": "0"}, {"max_count": "17"}, {"x": "1"}],
)
def test_other_settings_are_refused(host, bad):
    with pytest.raises(UserError):
        host.models["superpose"].settings(bad)
