"""Test frames of a sensor's reference scenes, in place of those that a protocol draws."""

from __future__ import annotations

from collections.abc import Iterable

from tactibench.contacts import Scene
from tactibench.errors import UserError
from tactibench.frames.presser import Presser
from tactibench.frames.source import Wanted, scored_limit, spread
from tactibench.protocols.draws import TIPS, fits
from tactibench.protocols.schema import Draw, Protocol
from tactibench.run.request import RunRequest

PART = 4
"""Of a draw, beside those of ``frames_drawn``: reference frames have noise of their own."""


def reference_frames(request: RunRequest, tester: Presser) -> tuple[tuple[Wanted, ...], int]:
    """Scenes with as many tips as the test draws have, and how many geometry refused.

    As in a draw, all tips lie in the protocol's workspace and inside its range of depths. There are
    no catch trials. Raises UserError where no scene is left, or the sensor has none.
    """
    keys, sensor = tester.pressed, tester.sensor
    scenes = sensor.scenes()
    if scenes is None:
        raise UserError(
            f"sensor {tester.part.name!r} stands for reference scenes, but does not say which; "
            "mend the plugin."
        )
    alike = {
        draw.name: [name for name, scene in scenes.items() if _asked(draw, scene)]
        for draw in _drawn(keys)
    }
    fitting = [
        (draw, name)
        for draw, names in alike.items()
        for name in names
        if fits(scenes[name], keys.workspace)
    ]
    if not fitting:
        raise UserError(
            f"none of the {len(scenes)} {tester.part.spec.scenes} of sensor {tester.part.name!r} "
            f"has the tips that protocol {keys.id!r} tests, inside its workspace; take another "
            "protocol, or leave --test reference out."
        )
    press = {name: name for name in scenes} | dict(sensor.presses())
    kept = spread(fitting, scored_limit(request))
    wanted = []
    for draw in dict.fromkeys(draw for draw, _ in kept):
        names = [name for of, name in kept if of == draw]
        wanted.append(
            tester.want(
                "test",
                draw,
                [scenes[name] for name in names],
                names,
                PART,
                [press[name] for name in names],
            )
        )
    return tuple(wanted), sum(map(len, alike.values())) - len(fitting)


def _drawn(keys: Protocol) -> Iterable[Draw]:
    """One test draw of each kind of indenter, without the catch trials."""
    found: dict[str, Draw] = {}
    for name in keys.test.sets:
        if name != keys.test.catch:
            draw = keys.draw(name)
            found.setdefault(draw.indenter, draw)
    return found.values()


def _asked(draw: Draw, scene: Scene) -> bool:
    tips = scene.indenter
    return len(tips.offsets) == TIPS[draw.indenter] and tips.radius == draw.radius_mm
