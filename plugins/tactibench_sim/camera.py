"""The camera of a sensor: records of numbers whose fields are the sensors' optical parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from math import isfinite
from typing import Any

from tactibench import Parameter, UserError

NUISANCES = ("shift", "roll", "zoom", "brightness", "background", "blur")
"""Properties of the camera that ``bounds`` may take as unknown: shift in its plane; turn about its
axis; magnification; a gain of all grey levels; an offset of all grey levels; focus."""
WHITE = 255


def option(default: Any, summary: str, *, name: str = "", **limits: Any) -> Any:
    """Return a field that users set as a parameter of the sensor.

    Args:
        default: Its value.
        summary: What it is, for lists of parameters.
        name: Name of the parameter, where the field has another one, with its unit.
        **limits: ``low``, ``high`` or ``choices`` of the parameter.
    """
    return field(default=default, metadata={"name": name, "summary": summary, "limits": limits})


@dataclass(frozen=True)
class Noise:
    """Gaussian noise of variance read^2 + 255 / full_well * grey (EMVA 1288, its linear model).

    Attributes:
        on: False leaves the frame as it is.
        read: Read noise, grey levels, rms (assumed).
        full_well: Electrons at grey level 255 (10,000 is a common small CMOS pixel; assumed).
    """

    on: bool = option(True, "camera noise on or off", name="noise")
    read: float = option(1.5, "read noise, grey levels rms", name="read_noise", low=0.0, high=50.0)
    full_well: float = option(1e4, "electrons at grey level 255 (shot noise)", low=100.0, high=1e12)

    @property
    def shot(self) -> float:
        """Variance per grey level."""
        return WHITE / self.full_well


@dataclass(frozen=True)
class Optics:
    """A camera that looks through a flat window into a gel with white markers.

    Camera coordinates: origin in the entrance pupil, z along the optical axis into the gel, x right
    and y down in the frame, mm. What the markers sit on plays no role here. Pixel (row i, column j)
    has its centre at y = i, x = j; without offset the axis meets ((size - 1) / 2) twice. "Side" is
    a frame's side.

    Attributes:
        size: Frame side, px.
        output: "grey" (H, W), "rgb" (H, W, 3) or "bw" (H, W).
        noise: Shot and read noise.
        brightness: Grey level of the tips on the axis (assumed).
        background: Grey level of the gel on the axis (assumed).
        edge_px: Half-width of a disc's smooth edge (blur of lens and pixel; assumed).
        blur_px: Sigma of a further Gaussian; 0: none.
        vignetting: Share v of the natural fall-off, light x (1 - v (1 - cos^4 a)); 0.3 assumed.
        marker_radius_mm: Radius of the white tips (assumed; the presets have those of the real
            sensors).
        pin_loss: Share of the markers that lost their white tip.
        camera_distance_mm: Distance from the camera to the farthest point of the gel (a dome's
            apex).
        lens: "pinhole" (r = f tan a) or "fisheye" (equidistant, r = f a), a the angle in air.
        focal: Focal length, sides.
        principal_x: Place where the axis meets the frame, from its middle, sides. Zero: nominal.
        principal_y: Likewise.
        roll_deg: Turn of the camera about its axis, x towards y. Zero: nominal.
        gel_mm: Gel (with skin) on the axis, from the farthest point to the window; 20: a dome
            filled to its equator (assumed).
        gel_index: Refractive index of the gel. 1.41: clear silicone gel (RTV27905 is one; assumed).
        window_mm: Thickness of the acrylic window; 2: assumed.
        window_index: Refractive index of the window, 1.49 (PMMA).
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

    Raises:
        UserError: A number is not finite, no air is left between camera and window, or the gel is
            not darker than the tips.
    """

    size: int = option(128, "frame side, px", low=32, high=1024)
    output: str = option(
        "grey",
        "frame format; bw: thresholded as real sets are",
        choices=("grey", "rgb", "bw"),
    )
    noise: Noise = Noise()
    brightness: float = option(208.0, "grey level of the pin tips", low=1.0, high=255.0)
    background: float = option(16.0, "grey level of the gel", low=0.0, high=254.0)
    edge_px: float = option(
        1.0, "half-width of a pin's soft edge, px", name="edge", low=0.5, high=10.0
    )
    blur_px: float = option(
        0.0, "sigma of a further Gaussian blur, px", name="blur", low=0.0, high=20.0
    )
    vignetting: float = option(0.3, "share of the natural fall-off cos^4", low=0.0, high=1.0)
    marker_radius_mm: float = option(
        0.4, "radius of the pins' white tips, mm", name="pin_radius", low=0.1, high=1.5
    )
    pin_loss: float = option(0.0, "share of pins without a white tip", low=0.0, high=0.9)
    camera_distance_mm: float = option(
        55.0, "from camera to apex, mm", name="camera_distance", low=10.0, high=200.0
    )
    lens: str = option(
        "pinhole",
        "projection: r = f tan a or (fisheye) r = f a",
        choices=("pinhole", "fisheye"),
    )
    focal: float = option(0.956, "focal length, frame sides", low=0.2, high=5.0)
    principal_x: float = option(0.0, "axis right of the frame's middle, sides", low=-0.3, high=0.3)
    principal_y: float = option(0.0, "axis below the frame's middle, sides", low=-0.3, high=0.3)
    roll_deg: float = option(
        0.0,
        "turn of the camera about its axis, x towards y, deg",
        name="roll",
        low=-180.0,
        high=180.0,
    )
    gel_mm: float = option(
        20.0, "from the apex to the window, mm", name="gel_length", low=1.0, high=100.0
    )
    gel_index: float = option(
        1.41, "refractive index of the gel; 1: no refraction", low=1.0, high=2.0
    )
    window_mm: float = option(
        2.0, "thickness of the acrylic window, mm", name="window_thickness", low=0.0, high=20.0
    )
    window_index: float = option(1.49, "refractive index of the window", low=1.0, high=2.0)
    glare: float = option(
        0.0, "light of the LEDs' reflections, 0: none, 1: as the tips", low=0.0, high=1.0
    )
    leds: int = option(6, "how many LEDs reflect", low=0, high=64)
    glare_start_deg: float = option(
        -5.0, "azimuth of the first LED, deg", name="glare_start", low=-180.0, high=180.0
    )
    glare_radius: float = option(
        0.47, "radius of the reflections' circle, sides", low=0.05, high=1.0
    )
    glare_width: float = option(
        0.017, "greatest thickness of a reflection, sides", low=0.0, high=0.2
    )
    glare_arc_deg: float = option(
        27.0, "length of a reflection, deg", name="glare_arc", low=1.0, high=360.0
    )
    glare_scatter: float = option(
        0.0, "irregularity of the reflections, 0: none", low=0.0, high=1.0
    )
    glare_seed: int = option(0, "which irregular reflections", low=0, high=10**9)
    red: float = option(0.92, "red share of white light (output rgb)", low=0.05, high=1.0)
    green: float = option(0.98, "green share of white light (output rgb)", low=0.05, high=1.0)
    blue: float = option(1.0, "blue share of white light (output rgb)", low=0.05, high=1.0)
    threshold_side: float = option(
        61 / 360, "block of the threshold (bw), sides", low=0.02, high=1.0
    )
    threshold_grey: float = option(
        5.0, "grey levels above the block (output bw)", name="threshold", low=0.0, high=100.0
    )

    def __post_init__(self) -> None:
        for name, number in (asdict(self) | asdict(self.noise)).items():
            if isinstance(number, float) and not isfinite(number):
                raise UserError(f"the optics' {name} is {number}; it must be a finite number.")
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


def parameters_of(optics: Optics) -> Iterator[Parameter]:
    """Yield the parameters that set a camera; their defaults are its values."""
    for record in (optics, optics.noise):
        for entry in fields(record):
            if entry.metadata:
                name, about = entry.metadata["name"] or entry.name, entry.metadata
                value = getattr(record, entry.name)
                yield Parameter(name, value, about["summary"], **about["limits"])


def optics_from(nominal: Optics, parameters: Mapping[str, Any]) -> Optics:
    """Return the nominal optics with the named parameters (``parameters_of``) set.

    Raises:
        UserError: The values fit no camera (``Optics``).
        TypeError: A name is no parameter.
    """
    noise = {e.metadata["name"] or e.name: e.name for e in fields(Noise)}
    names = {e.metadata["name"]: e.name for e in fields(Optics) if e.metadata.get("name")}
    values = {names.get(k, k): v for k, v in parameters.items() if k not in noise}
    changed = {noise[k]: v for k, v in parameters.items() if k in noise}
    return replace(nominal, **values, noise=replace(nominal.noise, **changed))


PLANAR_GRID = Optics(camera_distance_mm=30.0, focal=1.15, gel_mm=5.0, marker_radius_mm=0.3)
"""Camera 30 mm from the surface (28.5 mm in the GelSight Mini of the simulator TacEx, with 4.5 mm
of gel); the focal length shows the grid and 1.5 mm around it (assumed). Markers of 0.6 mm, white in
a dark gel like the pins of a TacTip (assumed; a GelSight's are dark in a lit one)."""


@dataclass(frozen=True)
class TacTipPreset:
    """Camera, lever and pins of a simulated TacTip, fitted to a public recording of the real one.

    Camera and lever were fitted to plate presses on the nominal dome; the thickness of the window
    counts as gel. With q the distance of a pin from the centre over that of the outermost pin in
    the rest frame, the radius of its white tip is ``optics.marker_radius_mm`` (1 + square q^2 +
    fourth q^4), even in q like every smooth function about an axis. It was fitted by least squares
    to the areas of the thresholded blobs of the real rest frame, to 1 %.

    Attributes:
        optics: The camera. Glare, where it is switched on, is six arcs (127 pins) or a closed ring
            that is thick at the LEDs (331).
        pin_length_mm: Effective lever of the pins, which the gel drags along.
        square: Coefficient of q^2.
        fourth: Coefficient of q^4.
    """

    optics: Optics
    pin_length_mm: float
    square: float
    fourth: float


_FITTED = Optics(window_mm=0.0, lens="fisheye", threshold_grey=50.0)
"""What the cameras of the real TacTips share. The threshold is about half of a tip's light: one of
5 cuts at the foot of a tip's edge, which hides how pins grow. In the presses of the fit, the areas
of the 331 set's innermost pins grow by a factor of 1.25; simulated ones by 1.21 with a threshold of
5 and by 1.24 with 50."""
TACTIPS = {
    127: TacTipPreset(
        replace(
            _FITTED, camera_distance_mm=23.352, focal=0.2897, gel_mm=22.852, marker_radius_mm=0.4132
        ),
        pin_length_mm=0.605,
        square=0.268,
        fourth=-0.275,
    ),
    331: TacTipPreset(
        replace(
            _FITTED,
            camera_distance_mm=23.486,
            focal=0.3388,
            gel_mm=21.486,
            marker_radius_mm=0.4074,
            glare_width=0.014,
            glare_arc_deg=80.0,
        ),
        pin_length_mm=0.403,
        square=0.957,
        fourth=-0.685,
    ),
}
"""Number of pins -> preset."""
