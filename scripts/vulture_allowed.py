"""Names that vulture takes for unused because libraries or files call them, not our code."""

# Classes that a spec names by text, as "package.module:Class"
CNN
CriRobot
Fitted127
Fitted331
GrblRobot
HeatAndDepth
HertzGaussian
Kernel
KernelSites
MeanModel
Mixture
NearestModel
Offsets
Pins
PinsSites
PlanarGrid
RecordedSensor
Reference127
Reference331
Superpose
SuperposeSites
TacTip
UNet
UrRobot
VGNN

# Properties of `tactibench check`: every public function of a module of checks is a property
another_grid
close_pair
context_manager
deeper
determinism
deterministic
finds_contacts
input_unchanged
nan_frame
psychometric  # a key of protocol files, with one value
pure
rest_frame
round_trip
save_load
scores
commits
filters
signatures

# Fields of a line of the journal, for readers of the file alone
contacts_depth_mm
contacts_xy_mm
n_contacts
# Keys of the description in a weights file
license
made_with
# Arguments that callers hand over: click's option, http.server's hook
debug
client_address
# Fields of a metric, read by the names in FIELDS
plate_sample
site_sample
