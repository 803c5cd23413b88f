"""What is pressed: dimensions and moduli of the bodies, in mm and units of the skin's modulus."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Dome:
    """The assumed dome. Lengths mm; moduli in units of the skin's.

    outer, skin: a TacTip dome of 40 mm diameter with a 1 mm skin (assumed from public designs).
    stiffness_ratio: E_skin / E_gel (assumed; 10 to 300 describe real plate presses equally well).
    apex_size, skin_size, gel_size: largest element edges. penalty: contact stiffness, E_skin / mm.
    """

    outer: float = 20.0
    skin: float = 1.0
    stiffness_ratio: float = 50.0
    apex_size: float = 0.08
    skin_size: float = 0.3
    gel_size: float = 1.2
    penalty: float = 100.0

    @property
    def inner(self) -> float:
        return self.outer - self.skin

    @property
    def moduli(self) -> dict[str, float]:
        return {"skin": 1.0, "gel": 1.0 / self.stiffness_ratio}


@dataclass(frozen=True)
class Pad:
    """A flat round pad of gel with a skin, bonded to a rigid backing; its side is free.

    Lengths mm; moduli in units of the skin's. thickness: gel and skin. skin: 0 for none, the gel's
    modulus is 1 / stiffness_ratio all the same. width: diameter. marker_depth: of the markers below
    the surface. contact_size: largest element edge of the surface within contact_radius of the
    axis; skin_size, gel_size: elsewhere. penalty: contact stiffness, E_skin / mm.
    """

    thickness: float = 10.0
    skin: float = 0.5
    stiffness_ratio: float = 10.0
    width: float = 60.0
    marker_depth: float = 1.0
    contact_size: float = 0.1
    contact_radius: float = 4.0
    skin_size: float = 0.5
    gel_size: float = 1.5
    penalty: float = 100.0

    def __post_init__(self) -> None:
        if not 0 <= self.skin < self.thickness:
            raise ValueError(f"skin is {self.skin} mm; it must be from 0 to below the thickness")
        if not 0 <= self.marker_depth < self.thickness:
            raise ValueError(f"marker_depth is {self.marker_depth} mm; it must be inside the pad")
        if not 0 < self.contact_radius < self.width / 2:
            raise ValueError(f"contact_radius is {self.contact_radius} mm; it must be on the pad")

    @property
    def moduli(self) -> dict[str, float]:
        gel = {"gel": 1.0 / self.stiffness_ratio}
        return {"skin": 1.0, **gel} if self.skin else gel
