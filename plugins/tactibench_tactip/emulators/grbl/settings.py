"""The settings $0 to $132 of GRBL 1.1h, with the defaults of a small stage."""

from __future__ import annotations

from collections.abc import Mapping

from tactibench import UserError

_WHOLE = {
    "$0": 10,
    "$1": 25,
    "$2": 0,
    "$3": 0,
    "$4": 0,
    "$5": 0,
    "$6": 0,
    "$10": 1,
    "$13": 0,
    "$20": 1,
    "$21": 1,
    "$22": 1,
    "$23": 0,
    "$26": 250,
    "$30": 1000,
    "$31": 0,
    "$32": 0,
}
_REAL = {
    "$11": 0.010,
    "$12": 0.002,
    "$24": 25.0,
    "$25": 500.0,
    "$27": 1.0,
    "$100": 250.0,
    "$101": 250.0,
    "$102": 250.0,
    "$110": 3000.0,
    "$111": 3000.0,
    "$112": 3000.0,
    "$120": 500.0,
    "$121": 500.0,
    "$122": 500.0,
    "$130": 200.0,
    "$131": 200.0,
    "$132": 200.0,
}
EXTRA_SOFT_LIMIT = 10
NEGATIVE, BELOW_3_US, BAD_STATEMENT, NO_HOMING = 4, 6, 3, 5


class Settings:
    """Numbers by name; mm, s, mm/min, steps/mm as in GRBL's documentation."""

    def __init__(self, given: Mapping[str, float] | None = None) -> None:
        """Raises UserError for a setting that GRBL does not have."""
        self.values: dict[str, float] = {**_WHOLE, **_REAL}
        for name, value in (given or {}).items():
            if name not in self.values:
                raise UserError(f"GRBL 1.1 has no setting {name!r}; known are {', '.join(self)}.")
            self.values[name] = float(value)

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(sorted(self.values, key=lambda name: int(name[1:])))

    def __getitem__(self, name: str) -> float:
        return self.values[name]

    def axes(self, first: int) -> tuple[float, float, float]:
        """x, y, z of a group such as 110."""
        x, y, z = (self.values[f"${first + k}"] for k in range(3))
        return x, y, z

    def write(self, name: str, text: str) -> int:
        """``name=text``; 0 or the error number of the firmware."""
        try:
            value = float(text)
        except ValueError:
            return 2
        if name not in self.values:
            return BAD_STATEMENT
        if value < 0:
            return NEGATIVE
        if name == "$0" and value < 3:
            return BELOW_3_US
        if name == "$20" and value and not self.values["$22"]:
            return EXTRA_SOFT_LIMIT
        self.values[name] = float(int(value)) if name in _WHOLE else value
        if name == "$22" and not value:
            self.values["$20"] = 0.0
        return 0

    def lines(self) -> list[str]:
        """What ``$$`` prints."""
        return [
            f"{name}={int(value)}" if name in _WHOLE else f"{name}={value:.3f}"
            for name in self
            for value in (self.values[name],)
        ]
