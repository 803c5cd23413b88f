"""Public names of tactibench.sweep, and the modules that define them."""

from .cells import AXES as AXES
from .cells import Cell as Cell
from .cells import SweepSpec as SweepSpec
from .cells import list_cells as list_cells
from .cells import read_choice as read_choice
from .cells import read_sweep as read_sweep
from .cluster import NO_GPU as NO_GPU
from .cluster import STATES as STATES
from .cluster import CellState as CellState
from .cluster import Storage as Storage
from .cluster import local_client as local_client
from .cluster import plan_cells as plan_cells
from .cluster import plan_requests as plan_requests
from .cluster import remote_client as remote_client
from .cluster import result_rows as result_rows
from .cluster import run_cell as run_cell
from .cluster import run_cells as run_cells
from .cluster import train_weights as train_weights
