"""Public names of tactibench, and the modules that they are imported from when they are used."""

from .channels import channel_vectors as channel_vectors
from .channels import holds_channels as holds_channels
from .contacts import Answer as Answer
from .contacts import Contacts as Contacts
from .contacts import Frame as Frame
from .contacts import Grid as Grid
from .contacts import Indenter as Indenter
from .contacts import PlatePose as PlatePose
from .contacts import Pose as Pose
from .contacts import Scene as Scene
from .contacts import Sites as Sites
from .contacts import Workspace as Workspace
from .errors import UserError as UserError
from .images import gray_frames as gray_frames
from .plugins.base import Encoder as Encoder
from .plugins.base import FitReport as FitReport
from .plugins.base import Model as Model
from .plugins.base import ModelContext as ModelContext
from .plugins.base import Prior as Prior
from .plugins.base import Progress as Progress
from .plugins.base import Sensor as Sensor
from .plugins.base import SensorContext as SensorContext
from .plugins.base import Stage as Stage
from .plugins.hookspecs import hookimpl as hookimpl
from .plugins.host import open_sensor as open_sensor
from .plugins.specs import CommandSpec as CommandSpec
from .plugins.specs import EncoderSpec as EncoderSpec
from .plugins.specs import ModelSpec as ModelSpec
from .plugins.specs import Parameter as Parameter
from .plugins.specs import SensorSpec as SensorSpec
from .plugins.specs import training_parameters as training_parameters

__version__: str
