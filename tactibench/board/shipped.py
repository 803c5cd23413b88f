"""The plugins that ship with tactibench, which a board trusts, and their declarations."""

from __future__ import annotations

from functools import cache

from tactibench.plugins import PluginHost, installed

OURS = "tactibench"
"""The distribution whose plugins are trusted."""


def trusted_host() -> PluginHost:
    """Return the plugins that ship with tactibench, and no others, even if others are installed."""
    return PluginHost(
        [(point, origin) for point, origin in installed() if origin.distribution == OURS]
    )


@cache
def deterministic_models() -> frozenset[str]:
    """Return the models that ship with tactibench and draw nothing when they are trained."""
    return frozenset(spec.name for spec in trusted_host().models if spec.deterministic)


@cache
def one_contact_models() -> frozenset[str]:
    """Return the models that ship with tactibench and answer one contact at most."""
    return frozenset(spec.name for spec in trusted_host().models if spec.max_contacts == 1)
