"""The plotting library as it travels in the page: compressed, and known to the page by its hash.

The browser unpacks it with its own ``DecompressionStream``: 4.8 MB of script become 2.0 MB of text.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
from dataclasses import dataclass

from tactibench.errors import UserError

LIBRARIES = "tactibench[report]"


@dataclass(frozen=True)
class Bundle:
    """packed: base64 of gzip. source: for the page's Content-Security-Policy."""

    packed: str
    source: str
    version: str


def plotly_bundle() -> Bundle:
    """The library of the installed plotly. Raises UserError where there is none."""
    try:
        import plotly
        from plotly.offline import get_plotlyjs
    except ImportError:
        raise missing("plotly") from None
    script = get_plotlyjs().encode()
    packed = gzip.compress(script, compresslevel=9, mtime=0)
    return Bundle(base64.b64encode(packed).decode(), script_source(script), plotly.__version__)


def script_source(script: bytes) -> str:
    """What allows this very script and no other: "sha256-..."."""
    return f"sha256-{base64.b64encode(hashlib.sha256(script).digest()).decode()}"


def missing(library: str) -> UserError:
    """The report needs libraries that nothing else does."""
    return UserError(
        f"the HTML report needs {library}, which is not installed; run `pip install '{LIBRARIES}'`."
    )
