"""What every encoder must hold."""

from __future__ import annotations

from tactibench.testing.encoder import maps, reading
from tactibench.testing.encoder.subject import EncoderSubject
from tactibench.testing.property import Property

PROPERTIES = tuple(
    Property.of(function)
    for function in (
        maps.target,
        maps.parameters,
        reading.empty,
        reading.round_trip,
        reading.border,
        reading.permutation,
        reading.shift,
        reading.refine,
        maps.noise,
        reading.close_pair,
        maps.pure,
        maps.dtype,
        maps.scores,
        maps.finite,
        maps.shape,
        maps.depth_range,
        maps.too_many,
        reading.another_grid,
        reading.several,
    )
)

__all__ = ["PROPERTIES", "EncoderSubject"]
