"""Public names of tactibench.markers, and the modules that define them."""

from .aligned_images import AlignedImages as AlignedImages
from .alignment import REACH as REACH
from .alignment import AlignedPins as AlignedPins
from .alignment import AlignedSensors as AlignedSensors
from .alignment import Outline as Outline
from .alignment import Similarity as Similarity
from .alignment import common_lattice as common_lattice
from .alignment import common_view as common_view
from .alignment import kriging_weights as kriging_weights
from .blobs import FAINTEST as FAINTEST
from .graph import PinGraph as PinGraph
from .graph import pin_graph as pin_graph
from .pin_tracker import BySensor as BySensor
from .pin_tracker import PinTracker as PinTracker
from .pin_tracker import PinView as PinView
from .pin_tracker import choose_light as choose_light
from .pin_tracker import find_pin_view as find_pin_view
from .pin_tracker import rest_images as rest_images
from .tracker import Tracker as Tracker
from .tracker import Tracks as Tracks
from .tracker import count_pins as count_pins
