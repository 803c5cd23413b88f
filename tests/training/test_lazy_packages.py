"""Packages for plugins import what they offer only when it is used."""

import importlib
import subprocess
import sys

import pytest

PACKAGES = ["tactibench.markers", "tactibench.superposition", "tactibench.training"]


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_the_package_loads_nothing_heavy(package):
    code = (
        f"import sys, {package} as package; package.__all__;"
        "print([m for m in ('numpy', 'scipy', 'cv2', 'numba', 'torch') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("package", PACKAGES)
def test_all_is_exactly_what_is_public(package):
    public = importlib.import_module(package)
    assert sorted(public.__all__) == sorted(name for name in dir(public) if name[0] != "_")
    assert all(getattr(public, name) is not None for name in public.__all__)
    with pytest.raises(AttributeError, match="nothing"):
        _ = public.nothing
