"""What the plugin declares."""

import pytest

from tactibench import UserError


def test_the_model_is_declared(host):
    spec = host.models["superpose"]
    assert spec.max_contacts is None
    assert spec.settings({}) == {"neighbours": "dome", "gain": 1.3, "max_count": 6}
    assert not spec.uses_encoder
    assert spec.load().__name__ == "Superpose"


@pytest.mark.parametrize(
    "bad",
    [{"neighbours": "plate"}, {"gain": "1.0"}, {"max_count": "0"}, {"max_count": "17"}, {"x": "1"}],
)
def test_other_settings_are_refused(host, bad):
    with pytest.raises(UserError):
        host.models["superpose"].settings(bad)


def test_declaring_imports_nothing_heavy():
    import subprocess
    import sys

    code = (
        "import sys, tactibench_superpose.hooks as h; list(h.tactibench_models()); "
        "print([m for m in ('numpy', 'torch', 'scipy', 'cv2') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
