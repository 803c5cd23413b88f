"""The configuration to start from."""

from __future__ import annotations

_ROBOT = {
    "ur": """driver = "ur"
address = "192.168.1.10"    # of the controller; remote control switched on at the pendant""",
    "grbl": """driver = "grbl"
address = "/dev/ttyUSB0"    # see `tactibench hw list`
home = true                 # drive to the switches ($H) whenever it is connected""",
    "cri": """driver = "cri"
address = "mylab.robots:make"   # a callable that makes an object with move_linear, pose, close""",
}
_WORK = {
    "ur": "[109.1, -487.0, 341.3, 180.0, 0.0, -90.0]",
    "grbl": "[-100.0, -100.0, -70.0, 180.0, 0.0, 0.0]",
}


def example_configuration(driver: str) -> str:
    """Return TOML in which every key says what it is for; driver: ur, grbl or cri."""
    tcp = (
        "[0.0, 0.0, 89.1, 0.0, 0.0, 0.0]" if driver != "grbl" else "[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]"
    )
    return f"""# A TacTip and what presses it. mm, deg (extrinsic x, y, z), N, s.
schema = 1

[robot]
{_ROBOT[driver]}
approach_mm_s = 20.0        # above the sensor
press_mm_s = 5.0            # down to the depth
retract_mm_s = 50.0
acceleration_mm_s2 = 500.0

[frames]
moves = "indenter"          # what the robot carries; "sensor": the indenter is bolted down
# Of the work frame in the robot's base: origin at the undeformed apex, z into the sensor.
work_frame = {_WORK.get(driver, _WORK["ur"])}
tcp_pose = {tcp}   # of the indenter's foremost point in the flange
sensor = [0.0, 0.0, 0.0]    # x, y of the apex and yaw of the image: `tactibench hw calibrate`

[camera]
source = "/dev/v4l/by-id/usb-CAMERA-video-index0"   # or a number, or an address
size = [640, 480]
fps = 30.0
fourcc = "MJPG"
exposure = 100.0            # in the camera's own unit; automatic exposure is switched off
crop = [80, 0, 480, 480]    # x, y, width, height that is kept
burst = 3                   # frames of one sample; their median is kept

[sensor]
name = "tactip-127"
dome_radius_mm = 20.0
deepest_mm = 6.5
pins = 127                  # leave out where pins are not to be counted

[indenter]
kind = "single"             # "dual" with distance_mm, "triple" with side_mm and heights_mm, "plate"
radius_mm = 3.0

[envelope]                  # of the tool, in the work frame; no safety function
half_width_mm = 12.0
above_mm = 60.0
below_mm = 10.0
clearance_mm = 10.0
tilt_deg = 25.0
max_force_n = 15.0

[contact]
method = "visual"           # or "force", "probe", "fixed"
every_presses = 250
every_minutes = 30.0

[timing]
settle_s = 0.2              # `tactibench hw settle-test` measures it

[safety]
auto_recover = 0            # protective stops released without asking
"""
