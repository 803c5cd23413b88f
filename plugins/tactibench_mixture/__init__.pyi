"""Public names of tactibench_mixture, and the modules that define them."""

from .model import DisplacementField as DisplacementField
from .model import Mixture as Mixture
from .model import MixtureNetwork as MixtureNetwork
