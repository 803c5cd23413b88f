"""Public names of tactibench_pins, and the modules that define them."""

from .displacements import LENGTHS as LENGTHS
from .displacements import RIDGES as RIDGES
from .displacements import SHARE as SHARE
from .displacements import Components as Components
from .displacements import Correction as Correction
from .displacements import Differences as Differences
from .displacements import LatticePins as LatticePins
from .displacements import OwnPins as OwnPins
from .displacements import contact_threshold as contact_threshold
from .displacements import find_reader as find_reader
from .displacements import read_answers as read_answers
from .displacements import rms_displacement as rms_displacement
from .field import ForwardModel as ForwardModel
from .field import Inversion as Inversion
from .kernel import Features as Features
from .kernel import Kernel as Kernel
from .kernel import Setting as Setting
from .kernel import choose_setting as choose_setting
from .kernel import kernel as kernel
from .kernel import kernel_weights as kernel_weights
from .model import Pins as Pins
