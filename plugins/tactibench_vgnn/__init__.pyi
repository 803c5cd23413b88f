"""Public names of tactibench_vgnn, and the modules that define them."""

from .model import NEAREST as NEAREST
from .model import NO_PIN as NO_PIN
from .model import NODE as NODE
from .model import VGNN as VGNN
from .model import GraphNetwork as GraphNetwork
from .model import PinLayout as PinLayout
from .model import neighbour_table as neighbour_table
from .model import node_features as node_features
