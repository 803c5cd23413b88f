"""Names that vulture takes for unused because libraries or files call them, not our code."""

# Classes that a spec names by text, as "package.module:Class"
CNN
Fitted127
Fitted331
HeatAndDepth
HertzGaussian
MeanModel
Mixture
NearestModel
Offsets
Pins
PlanarGrid
RecordedSensor
Reference127
Reference331
Superpose
TacTip
UNet
VGNN
