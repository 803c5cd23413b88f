"""Public names of tactibench_heatmaps, and the modules that define them."""

from .encoders import HeatAndDepth as HeatAndDepth
from .encoders import HertzGaussian as HertzGaussian
from .encoders import Mixture as Mixture
from .encoders import Offsets as Offsets
from .peaks import CANDIDATES as CANDIDATES
from .peaks import PeakReader as PeakReader
