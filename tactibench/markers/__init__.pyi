"""Public names of tactibench.markers, and the modules that define them."""

from .aligned_images import AlignedImages as AlignedImages
from .aligned_pins import AlignedPins as AlignedPins
from .aligned_pins import AlignedSensors as AlignedSensors
from .aligned_pins import Similarity as Similarity
from .blobs import FAINTEST as FAINTEST
from .common_view import REACH as REACH
from .common_view import Outline as Outline
from .common_view import common_lattice as common_lattice
from .common_view import common_view as common_view
from .common_view import kriging_weights as kriging_weights
from .graph import PinGraph as PinGraph
from .graph import pin_graph as pin_graph
from .pin_tracker import BySensor as BySensor
from .pin_tracker import PinTracker as PinTracker
from .pin_tracker import rest_images as rest_images
from .pin_view import PinView as PinView
from .pin_view import find_pin_view as find_pin_view
from .pin_view import is_raw as is_raw
from .tracker import Tracker as Tracker
from .tracker import Tracks as Tracks
from .tracker import count_pins as count_pins
from .tracker import rest_layout as rest_layout
