"""A verb: a click command."""

import click


@click.command()
@click.argument("sensor")
def greet(sensor):
    """Say hello to SENSOR."""
    click.echo(f"hello, {sensor}")
