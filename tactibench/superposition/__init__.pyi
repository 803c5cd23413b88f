"""Public names of tactibench.superposition, and the modules that define them."""

from .compiled import hold_of as hold_of
from .field import FEWEST as FEWEST
from .field import MARGIN_MM as MARGIN_MM
from .field import PITCH_MM as PITCH_MM
from .field import RIDGES as RIDGES
from .field import SENSORS_A_WAY as SENSORS_A_WAY
from .field import Clues as Clues
from .field import Field as Field
from .field import FieldFamily as FieldFamily
from .field import Solution as Solution
from .field import contact_array as contact_array
from .field import cost_of as cost_of
from .field import evidence as evidence
from .field import matern as matern
from .field import single_press_rows as single_press_rows
from .field import solve as solve
from .mixing import CLOSEST_MM as CLOSEST_MM
from .mixing import MISFIT as MISFIT
from .mixing import MOST as MOST
from .mixing import PinPicture as PinPicture
from .mixing import mix as mix
from .neighbours import NeighbourLaw as NeighbourLaw
from .neighbours import Residual as Residual
from .neighbours import nominal_inverse_law as nominal_inverse_law
from .neighbours import nominal_law as nominal_law
from .neighbours import recombined as recombined
