"""Public names of tactibench_heatmaps, and the modules that define them."""

from .discs import HeatAndDepth as HeatAndDepth
from .discs import Offsets as Offsets
from .encoder import PeakReader as PeakReader
from .hertz import HertzGaussian as HertzGaussian
from .least_squares import three_points as three_points
from .maxima import CANDIDATES as CANDIDATES
from .mixture import Mixture as Mixture
