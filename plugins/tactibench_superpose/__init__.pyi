"""Public names of tactibench_superpose, and the modules that define them."""

from .detect import CLOSEST_MM as CLOSEST_MM
from .detect import FEWEST as FEWEST
from .detect import Detector as Detector
from .detect import ModelError as ModelError
from .learned import ErrorCauses as ErrorCauses
from .learned import Spread as Spread
from .learned import nominal_spread as nominal_spread
from .model import Superpose as Superpose
