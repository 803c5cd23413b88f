"""A sensor by name: how one plugin reaches another's."""

from __future__ import annotations

from collections.abc import Mapping

from tactibench.plugins.base import Sensor, SensorContext
from tactibench.plugins.host import PluginHost


def open_sensor(
    name: str,
    context: SensorContext,
    given: Mapping[str, str],
    *,
    preferred: Mapping[str, str] | None = None,
) -> Sensor:
    """The sensor of that name, of whichever installed plugin; it is still to be entered.

    given: parameters as on the command line. preferred: parameters that are used where the sensor
    has them and ``given`` does not say otherwise. Raises UserError for an unknown name or
    parameter, or a value that is not allowed.
    """
    spec = PluginHost().sensors[name]
    known = {parameter.name for parameter in spec.parameters}
    wanted = {key: value for key, value in (preferred or {}).items() if key in known}
    values = spec.settings({**wanted, **given})  # before anything heavy is imported
    return spec.load()(context, **values)
