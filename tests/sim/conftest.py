"""The makers of the simulator's tables are scripts, which stand in no package."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts" / "fem"))
