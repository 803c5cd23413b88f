"""Public names of tactibench_superpose, and the modules that define them."""

from .detect import CLOSEST_MM as CLOSEST_MM
from .detect import FEWEST as FEWEST
from .detect import Detector as Detector
from .detect import ModelError as ModelError
from .model import Superpose as Superpose
