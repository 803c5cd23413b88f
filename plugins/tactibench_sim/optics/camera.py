"""The camera of a sensor as one frozen record of numbers, and the parameters that set it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from math import isfinite
from typing import Any

from tactibench import UserError
from tactibench_sim.optics.noise import Noise

LENSES = ("pinhole", "fisheye")
OUTPUTS = ("grey", "rgb", "bw")
NUISANCES = ("shift", "roll", "zoom", "brightness", "background", "blur")
"""Properties of the camera that ``bounds`` may take as unknown: shift in its plane; turn about its
axis; magnification; a gain of all grey levels; an offset of all grey levels; focus."""


@dataclass(frozen=True)
class Optics:
    """A camera that looks through a flat window into a gel with white markers.

    Camera coordinates: origin in the entrance pupil, z along the optical axis into the gel, x right
    and y down in the frame, mm. What the markers sit on plays no role here. Pixel (row i, column j)
    has its centre at y = i, x = j; without offset the axis meets ((size - 1) / 2) twice. "Side" is
    a frame's side.

    Attributes:
        size: Frame side, px.
        camera_distance_mm: Distance from the camera to the farthest point of the gel (a dome's
            apex). 55: a public TacTip simulation.
        lens: "pinhole" (r = f tan a) or "fisheye" (equidistant, r = f a), a the angle in air.
        focal: Focal length, sides. 0.956 puts the outermost pins of the real 331-pin rest frame 65
            deg from the apex (ten steps of 6.5 deg; assumed), a field of view of 55 deg.
        principal_x: Place where the axis meets the frame, from its middle, sides. Zero: nominal.
        principal_y: Likewise.
        roll_deg: Turn of the camera about its axis, x towards y. Zero: nominal.
        gel_mm: Gel (with skin) on the axis, from the farthest point to the window; 20: a dome
            filled to its equator (assumed).
        gel_index: Refractive index of the gel. 1.41: clear silicone gel (RTV27905 is one; assumed).
        window_mm: Thickness of the acrylic window; 2: assumed.
        window_index: Refractive index of the window, 1.49 (PMMA).
        marker_radius_mm: Radius of the white tips (assumed; the presets have those of the real
            sensors).
        edge_px: Half-width of a disc's smooth edge (blur of lens and pixel; assumed).
        blur_px: Sigma of a further Gaussian; 0: none.
        vignetting: Share v of the natural fall-off, light x (1 - v (1 - cos^4 a)); 0.3 assumed.
        background: Grey level of the gel on the axis (assumed).
        brightness: Grey level of the tips on the axis (assumed).
        glare: Light of the LEDs' reflections at the rim; 1: as bright as the tips, 0: none. From
            the real rest frames: radius 0.47, six LEDs, arcs of 27 deg (127 pins) to a closed ring
            (331).
        leds: Number of LEDs.
        glare_start_deg: Azimuth of the first LED, x towards y.
        glare_radius: Radius of the circle of the reflections, sides.
        glare_width: Greatest thickness of an arc, sides.
        glare_arc_deg: Length of an arc.
        glare_scatter: Irregularity of the arcs; 0: all alike, 1: lengths and thicknesses differ by
            factors of up to 2.
        glare_seed: Seed from which irregular arcs are drawn.
        red: Red share of white light in output "rgb" (bluish LEDs, no white balance; assumed).
        green: Green share, likewise.
        blue: Blue share, likewise.
        threshold_side: Side of the block of output "bw", sides. A pixel is white where it exceeds
            the Gaussian-weighted mean of the block around it by ``threshold_grey``. 61 of 360 px
            and 5, as for the real Tac-VGNN frames (``threshold`` in their meta.json).
        threshold_grey: Grey levels above that mean.
        output: "grey" (H, W), "rgb" (H, W, 3) or "bw" (H, W).
        pin_loss: Share of the markers that lost their white tip.
        noise: Shot and read noise.

    Raises:
        UserError: A name or a number fits no camera, no air is left between camera and window, or
            the gel is not darker than the tips.
    """

    size: int = 128
    camera_distance_mm: float = 55.0
    lens: str = "pinhole"
    focal: float = 0.956
    principal_x: float = 0.0
    principal_y: float = 0.0
    roll_deg: float = 0.0
    gel_mm: float = 20.0
    gel_index: float = 1.41
    window_mm: float = 2.0
    window_index: float = 1.49
    marker_radius_mm: float = 0.4
    edge_px: float = 1.0
    blur_px: float = 0.0
    vignetting: float = 0.3
    background: float = 16.0
    brightness: float = 208.0
    glare: float = 0.0
    leds: int = 6
    glare_start_deg: float = -5.0
    glare_radius: float = 0.47
    glare_width: float = 0.017
    glare_arc_deg: float = 27.0
    glare_scatter: float = 0.0
    glare_seed: int = 0
    red: float = 0.92
    green: float = 0.98
    blue: float = 1.0
    threshold_side: float = 61 / 360
    threshold_grey: float = 5.0
    output: str = "grey"
    pin_loss: float = 0.0
    noise: Noise = field(default_factory=Noise)

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("lens", self.lens, LENSES),
            ("output", self.output, OUTPUTS),
        ):
            if value not in allowed:
                raise UserError(f"the {name} is {value!r}; allowed: {', '.join(allowed)}.")
        numbers = asdict(self) | asdict(self.noise)
        for name, number in numbers.items():
            if isinstance(number, float) and not isfinite(number):
                raise UserError(f"the optics' {name} is {number}; it must be a finite number.")
        for name, low in _AT_LEAST.items():
            if numbers[name] < low:
                raise UserError(f"the optics' {name} is {numbers[name]:g}; use {low:g} or more.")
        if not self.air_mm > 0:
            raise UserError(
                f"the camera is {self.camera_distance_mm:g} mm from the end of a gel of "
                f"{self.gel_mm:g} mm behind a window of {self.window_mm:g} mm; move it away until "
                "air is left between camera and window."
            )
        if not self.background < self.brightness:
            raise UserError(
                f"the gel's grey level {self.background:g} is not below the tips' "
                f"{self.brightness:g}; make the tips brighter."
            )

    def describe(self) -> dict[str, Any]:
        """Return all values, as records hold them; those of irregular glare where it is used."""
        out = asdict(self)
        if not self.glare_scatter:
            del out["glare_scatter"], out["glare_seed"]
        return out

    @property
    def air_mm(self) -> float:
        """Distance from the camera to the window."""
        return self.camera_distance_mm - self.gel_mm - self.window_mm

    @property
    def tint(self) -> tuple[float, ...]:
        """Light in each channel of the frame for white light of 1."""
        return (self.red, self.green, self.blue) if self.output == "rgb" else (1.0,)


_AT_LEAST = {
    "size": 1,
    "focal": 1e-3,
    "gel_mm": 0,
    "window_mm": 0,
    "gel_index": 1,
    "window_index": 1,
    "marker_radius_mm": 0,
    "edge_px": 0.01,
    "blur_px": 0,
    "background": 0,
    "glare": 0,
    "leds": 0,
    "glare_arc_deg": 1,
    "glare_scatter": 0,
    "glare_seed": 0,
    "red": 1e-3,
    "green": 1e-3,
    "blue": 1e-3,
    "pin_loss": 0,
    "read": 0,
    "full_well": 1,
}

FIELDS = {
    "edge": "edge_px",
    "blur": "blur_px",
    "pin_radius": "marker_radius_mm",
    "camera_distance": "camera_distance_mm",
    "roll": "roll_deg",
    "gel_length": "gel_mm",
    "window_thickness": "window_mm",
    "glare_start": "glare_start_deg",
    "glare_arc": "glare_arc_deg",
    "threshold": "threshold_grey",
}
"""Parameter -> field of ``Optics``, where the field has another name, with its unit."""
NOISE_FIELDS = {"noise": "on", "read_noise": "read", "full_well": "full_well"}
"""Parameter -> field of ``Noise``."""


def optics_from(nominal: Optics, parameters: Mapping[str, Any]) -> Optics:
    """Return the nominal optics with the named parameters of ``hooks.OPTICAL`` set.

    Raises:
        UserError: The values fit no camera (``Optics``).
        TypeError: A name is no parameter.
    """
    noise = {NOISE_FIELDS[k]: v for k, v in parameters.items() if k in NOISE_FIELDS}
    values = {FIELDS.get(k, k): v for k, v in parameters.items() if k not in NOISE_FIELDS}
    return replace(nominal, **values, noise=replace(nominal.noise, **noise))
