"""The command `tactibench hw`: its verbs by name, imported when they are called."""

from __future__ import annotations

from importlib import import_module

import click

VERBS = {
    "calibrate": ("calibrate", "find where the sensor sits, and how long a press settles"),
    "collect": ("collect", "press a protocol's presses and keep the frames"),
    "doctor": ("devices", "say what is reachable, and what is not as the configuration says"),
    "example": ("devices", "write a commented configuration to start from"),
    "jog": ("devices", "move the tool by hand, inside the envelope; home a stage"),
    "live": ("live", "watch camera, pins, contacts and the latency of the loop"),
    "plan": ("collect", "check the presses of a protocol before anything moves"),
}
"""Name -> module beside this one, which has the verb as an attribute, and a few words."""


class Verbs(click.Group):
    """Verbs by name, imported when they are called."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        """Return the names, sorted."""
        return sorted(VERBS)

    def get_command(self, _ctx: click.Context, name: str) -> click.Command | None:
        """Import and return a verb.

        Raises:
            UserError: There is no such verb.
        """
        if name not in VERBS:
            from tactibench import UserError  # `hw --help` loads nothing heavy
            from tactibench.lab import did_you_mean

            raise UserError(f"unknown command 'hw {name}'; {did_you_mean(name, VERBS)}")
        module = import_module(f"tactibench_tactip.commands.{VERBS[name][0]}")
        command: click.Command = getattr(module, name)
        return command

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in sorted(VERBS.items())])


@click.group(cls=Verbs, name="hw")
def hw() -> None:
    """Work with a real TacTip under a UR arm or a serial stage.

    \b
    tactibench hw example lab.toml                      a configuration to start from
    tactibench hw collect exp1 --config lab.toml --emulate --count 20 --out data/try
    tactibench hw doctor --config lab.toml              then the real devices

    Verbs that open devices take --emulate to rehearse with a simulated robot and camera. Limits of
    a configuration are no safety function: see docs/hardware.md.
    """
