"""Public names of tactibench_unet, and the modules that define them."""

from .architecture import GAIN as GAIN
from .architecture import UNetNetwork as UNetNetwork
from .architecture import disturb as disturb
from .model import UNet as UNet
from .model import least_share as least_share
