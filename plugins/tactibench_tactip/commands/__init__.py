"""The command `tactibench hw`: its verbs by name, imported when they are called."""

from __future__ import annotations

from importlib import import_module

import click

VERBS = {
    "calibrate": ("calibrate", "find where the sensor sits: centre and yaw from presses"),
    "collect": ("collect", "press a protocol's presses and keep the frames"),
    "doctor": ("doctor", "say what is reachable, and what is not as the configuration says"),
    "emulate": ("emulate", "run emulators of all that a configuration names, and print one"),
    "jog": ("jog", "move the tool by hand, inside the envelope; home a stage"),
    "list": ("list_devices", "list cameras and serial ports"),
    "live": ("live", "watch camera, pins, contacts and the latency of the loop"),
    "plan": ("plan", "check the presses of a protocol before anything moves, and draw them"),
    "replay": ("replay", "press some of a data set again and compare the frames"),
    "settle-test": ("settle_test", "see how long the skin creeps after a press"),
}


class Verbs(click.Group):
    """Verbs by name; each is the attribute ``command`` of a module beside this one."""

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
        command: click.Command = module.command
        return command

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the verbs without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in sorted(VERBS.items())])


@click.group(cls=Verbs, name="hw")
def hw() -> None:
    """Work with a real TacTip under a UR arm or a serial stage.

    \b
    tactibench hw emulate --write lab.toml              a configuration to start from
    tactibench hw collect exp1 --config lab.toml --emulate --count 20 --out data/try
    tactibench hw doctor --config lab.toml              then the real devices

    Verbs that open devices take --emulate to rehearse on emulators. Limits of a configuration are
    no safety function: see docs/hardware.md.
    """
