"""Test frames of a sensor's reference scenes, in place of those that a protocol draws."""

from __future__ import annotations

from functools import cached_property

from tactibench.contacts import Scene
from tactibench.errors import UserError
from tactibench.frames.drawn_presses import DrawnFrames
from tactibench.frames.source import FrameSet, spread
from tactibench.protocols import Draw, fits

PART = 4
"""Number of the part of a draw, whose frames have noise of their own: not used by
``protocols.split``."""


class ReferenceFrames(DrawnFrames):
    """Scenes with as many tips as the test draws have, in the protocol's workspace and depths.

    There are no catch trials.
    """

    def test_frames(self) -> tuple[FrameSet, ...]:
        """Return the scenes that fit the workspace, by draw.

        Raises:
            UserError: No scene has the tips of a test draw inside the workspace, or the sensor does
                not name its scenes.
        """
        component, workspace = self.testing.component, self.testing.pressed.workspace
        fitting = [
            (draw, name)
            for draw, names in self._alike.items()
            for name in names
            if fits(self._scenes[name], workspace)
        ]
        if not fitting:
            raise UserError(
                f"none of the {len(self._scenes)} {component.spec.scenes} of sensor "
                f"{component.name!r} has the tips that protocol {self.spec.id!r} tests, inside its "
                "workspace; take another protocol, or leave --test reference out."
            )
        presses = self.testing.sensor.presses()
        chosen = spread(fitting, self.request.test_count)
        sets = []
        for draw in dict.fromkeys(draw for draw, _ in chosen):
            names = [name for of, name in chosen if of == draw]
            sets.append(
                self.testing.frame_set(
                    "test",
                    draw,
                    [self._scenes[name] for name in names],
                    names,
                    PART,
                    presses=[presses.get(name, name) for name in names],
                )
            )
        return tuple(sets)

    def rejected(self) -> int:
        """Return how many scenes with the right tips lie outside of the workspace."""
        workspace = self.testing.pressed.workspace
        names = [name for names in self._alike.values() for name in names]
        return sum(not fits(self._scenes[name], workspace) for name in names)

    @cached_property
    def _scenes(self) -> dict[str, Scene]:
        scenes = self.testing.sensor.scenes()
        if scenes is None:
            raise UserError(
                f"sensor {self.testing.component.name!r} stands for reference scenes, but does not "
                "say which; fix the plugin."
            )
        return dict(scenes)

    @cached_property
    def _alike(self) -> dict[str, list[str]]:
        """Test draw -> scenes with its tips; one draw of each kind of indenter, no catch trials."""
        draws: dict[str, Draw] = {}
        for name in self.spec.test.sets:
            if name != self.spec.test.catch:
                draw = self.spec.draw(name)
                draws.setdefault(draw.indenter, draw)
        return {
            draw.name: [name for name, scene in self._scenes.items() if _has_tips_of(scene, draw)]
            for draw in draws.values()
        }


def _has_tips_of(scene: Scene, draw: Draw) -> bool:
    tips = scene.indenter
    return len(tips.offsets) == draw.tips and tips.radius == draw.radius_mm
