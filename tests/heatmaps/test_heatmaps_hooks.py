"""The declaration and the class behind it agree."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys

from tactibench_heatmaps.hooks import tactibench_encoders


def test_declared_defaults_are_the_classes():
    (spec,) = tactibench_encoders()
    assert spec.name == "hertz"
    signature = inspect.signature(spec.load()).parameters
    assert spec.settings({}) == {name: p.default for name, p in signature.items()}
    encoder = spec.load()(**spec.settings({"decoder": "maximum", "window": "7"}))
    assert encoder.channels == 1


def test_what_shapes_the_maps_is_not_decode_only():
    (spec,) = tactibench_encoders()
    shaping = {p.name for p in spec.parameters if not p.decode_only}
    assert shaping == {"max_depth", "radius", "blur"}


def test_declaring_is_light():
    code = (
        "import sys, tactibench_heatmaps.hooks as h; h.tactibench_encoders();"
        "sys.exit(bool({'numpy', 'torch', 'cv2'} & set(sys.modules)))"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    done = subprocess.run([sys.executable, "-c", code], check=False, env=environment)
    assert done.returncode == 0
