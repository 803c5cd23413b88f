"""Meridian meshes: half sections of axisymmetric bodies, materials glued, boundaries named."""

from __future__ import annotations

import math
from typing import Any

from tactibench_sim.fem.bodies import Dome, Pad
from tactibench_sim.fem.extra import require_ngsolve


def dome_meridian(dome: Dome) -> Any:
    """Quarter discs of gel and skin, fine at the apex, curved elements."""
    ngs = require_ngsolve()
    from netgen.occ import Glue, OCCGeometry, Rectangle, WorkPlane

    quarter = Rectangle(2 * dome.outer, 2 * dome.outer).Face()
    full = WorkPlane().Circle(dome.outer).Face() * quarter
    gel = WorkPlane().Circle(dome.inner).Face() * quarter
    skin = full - gel
    gel.faces.name, gel.faces.maxh = "gel", dome.gel_size
    skin.faces.name, skin.faces.maxh = "skin", dome.skin_size
    shape = Glue([skin, gel])
    for edge in shape.edges:
        (x0, y0, _), (x1, y1, _) = edge.start, edge.end
        if max(abs(x0), abs(x1)) < 1e-9:
            edge.name = "axis"
        elif max(abs(y0), abs(y1)) < 1e-9:
            edge.name = "base"
        else:
            edge.name = "outer" if math.hypot(x0, y0) > dome.inner + 1e-9 else "interface"
            edge.maxh = dome.skin_size
    for vertex in shape.vertices:
        x, y, _ = vertex.p
        if abs(x) < 1e-9 and y > dome.inner - 1e-9:
            vertex.maxh = dome.apex_size
    netgen = OCCGeometry(shape, dim=2).GenerateMesh(maxh=dome.gel_size, grading=0.15)
    mesh = ngs.Mesh(netgen)
    mesh.Curve(3)
    return mesh


def pad_meridian(pad: Pad) -> Any:
    """Rectangles of gel and skin on the backing at height 0, fine at the contact."""
    ngs = require_ngsolve()
    from netgen.occ import Glue, OCCGeometry, WorkPlane

    inner, side, top = pad.contact_radius, pad.width / 2, pad.thickness
    layers = [("gel", 0.0, top - pad.skin, pad.gel_size)]
    if pad.skin:
        layers.append(("skin", top - pad.skin, top, pad.skin_size))
    parts = []
    for name, low, high, size in layers:
        for left, right in ((0.0, inner), (inner, side)):
            part = WorkPlane().MoveTo(left, low).Rectangle(right - left, high - low).Face()
            part.faces.name, part.faces.maxh = name, size
            parts.append(part)
    shape = Glue(parts)
    for edge in shape.edges:
        (x0, y0, _), (x1, y1, _) = edge.start, edge.end
        if max(abs(x0), abs(x1)) < 1e-9:
            edge.name = "axis"
        elif max(abs(y0), abs(y1)) < 1e-9:
            edge.name = "base"
        elif min(y0, y1) > top - 1e-9:
            edge.name = "outer"
            edge.maxh = pad.contact_size if max(x0, x1) < inner + 1e-9 else layers[-1][3]
        else:
            edge.name = "interface" if abs(y0 - y1) < 1e-9 else "side"
    return ngs.Mesh(OCCGeometry(shape, dim=2).GenerateMesh(maxh=pad.gel_size, grading=0.15))
