"""Public names of tactibench_unet, and the modules that define them."""

from .model import UNet as UNet
from .model import UNetNetwork as UNetNetwork
from .model import disturb as disturb
from .model import least_share as least_share
