"""Fit the errors that ``superpose`` states where no training press shows several contacts.

    python benchmarks/spread.py [--presses 400] [--write]

All presses are of the nominal simulated tactip-127 with noise. The model learns from single presses
of exp1. It answers single presses that it did not see, and pairs and triples at random places and
depths, 6.5 mm apart or more (none of them a press of a protocol's test). Printed are the terms of
``Spread``, and the share of truths in the 95 % ellipse and interval on presses to which the terms
were not fitted. ``--write`` replaces the terms that ship
(plugins/tactibench_superpose/spread.json).
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from neighbours import free_contacts, scene_of

import tactibench_superpose
from tactibench import Contacts, Frame, ModelContext, Scene, SensorContext
from tactibench.plugins import PluginHost
from tactibench.protocols import draw_scenes, load_protocol
from tactibench_superpose.model import Superpose
from tactibench_superpose.spread import GROUPS, Spread

APART_MM = 6.5
LEARNED, HELD = 3600, 1000
"""Numbers of presses of exp1's draw: those for training, and those that are answered."""


def main() -> None:
    parser = argparse.ArgumentParser(description="errors that superpose states of itself")
    parser.add_argument("--presses", type=int, default=400, help="of two and of three contacts")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    rng = np.random.default_rng(20260102)
    protocol = load_protocol("exp1").spec
    spec = PluginHost().sensors["tactip-127"]
    sensor = spec.load()(SensorContext(np.random.SeedSequence(1)), **spec.settings({}))
    scenes = list(draw_scenes(protocol, "singles").scenes[: LEARNED + HELD])
    alone = np.array([[[s.pose.x, s.pose.y, s.pose.depth]] for s in scenes])
    with sensor:

        def pressed(wanted: list[Scene]) -> list[Frame]:
            return list(sensor.press_many(wanted))

        frames = pressed(scenes)
        sets = [(frames[LEARNED:], alone[LEARNED:])]
        for count in range(2, GROUPS + 1):
            contacts = free_contacts(options.presses, count, rng, APART_MM)
            sets.append((pressed([scene_of(c) for c in contacts]), contacts))
    model = Superpose(
        ModelContext("contacts", protocol.grid.grid(), protocol.workspace.depth_max_mm)
    )
    truth = [Contacts.truth(contact[:, :2], contact[:, 2]) for contact in alone[:LEARNED]]
    model.fit(frames[:LEARNED], truth, validation=([], []), rng=rng, progress=_silent())
    spread = Spread(np.zeros((GROUPS, 2, 4)))
    for seen, contacts in sets:
        clues, errors = model.errors(seen, contacts)
        count = contacts.shape[1]
        spread = spread.with_group(count, clues[::2], errors[::2])
        z = np.concatenate(
            [e / spread.std(c) for c, e in zip(clues[1::2], errors[1::2], strict=True)]
        )
        print(
            f"{count} contacts, {len(errors)} of {len(seen)} presses with as many found; terms of "
            f"x and y {spread.terms[count - 1, 0].round(4).tolist()}, depth "
            f"{spread.terms[count - 1, 1].round(4).tolist()}; held out: "
            f"{np.mean(np.hypot(z[:, 0], z[:, 1]) < 2.447747):.3f} in the ellipse, "
            f"{np.mean(np.abs(z[:, 2]) < 1.959964):.3f} in the interval of depth"
        )
    if options.write:
        path = Path(tactibench_superpose.__file__).with_name("spread.json")
        path.write_text(json.dumps({"terms": spread.terms.round(5).tolist()}, indent=1) + "\n")
        print(f"wrote {path.name}")


def _silent() -> SimpleNamespace:
    """Return a Progress that shows nothing."""
    return SimpleNamespace(
        start=lambda epochs, steps: None,  # noqa: ARG005
        step=lambda loss: None,  # noqa: ARG005
        epoch=lambda epoch, loss, validation_mm: None,  # noqa: ARG005
    )


if __name__ == "__main__":
    main()
