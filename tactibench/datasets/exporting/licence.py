"""The licence of a data set in the words of others: SPDX, the Hugging Face Hub."""

from __future__ import annotations

UNKNOWN = "unknown"
"""What the Hub's cards call it, too: https://huggingface.co/docs/hub/repositories-licenses."""

_SPDX = (
    *("Apache-2.0", "MIT", "BSD-2-Clause", "BSD-3-Clause", "MPL-2.0", "Unlicense", "AGPL-3.0-only"),
    *("GPL-2.0-only", "GPL-3.0-only", "GPL-3.0-or-later", "LGPL-2.1-only", "LGPL-3.0-only"),
    *("CC0-1.0", "CC-BY-2.0", "CC-BY-3.0", "CC-BY-4.0", "CC-BY-SA-3.0", "CC-BY-SA-4.0"),
    *("CC-BY-NC-3.0", "CC-BY-NC-4.0", "CC-BY-ND-4.0", "CC-BY-NC-ND-4.0", "CC-BY-NC-SA-4.0"),
    *("CDLA-Permissive-1.0", "CDLA-Permissive-2.0", "CDLA-Sharing-1.0"),
    *("ODbL-1.0", "ODC-By-1.0", "PDDL-1.0"),
)
_KNOWN = {name.lower(): name for name in _SPDX}
_ON_THE_HUB = {"ODbL-1.0": "odbl", "ODC-By-1.0": "odc-by", "PDDL-1.0": "pddl"}


def named(licence: str | None) -> str | None:
    """The licence as it is to be written, None where nobody said what it is."""
    text = " ".join((licence or "").split())
    return None if text.lower() in {"", UNKNOWN, "none"} else _KNOWN.get(text.lower(), text)


def address(licence: str) -> str:
    """SPDX page of a licence of its list; anything else (a link, a name) as it is."""
    known = licence in _KNOWN.values()
    return f"https://spdx.org/licenses/{licence}.html" if known else licence


def hub_keys(licence: str | None) -> dict[str, str]:
    """The keys of a dataset card's front matter; ``licence`` as ``named`` gives it."""
    if licence is None:
        return {"license": UNKNOWN}
    if licence not in _KNOWN.values():
        return {"license": "other", "license_name": licence}
    plain = licence.removesuffix("-only").removesuffix("-or-later")
    return {"license": _ON_THE_HUB.get(licence, plain.lower())}


def sentence(licence: str | None) -> str:
    """For people."""
    if licence is None:
        return "The licence of this data set is unknown: ask whoever recorded it before using it."
    return f"Licence: {licence}."
