"""``tactibench list`` and ``describe``."""

from __future__ import annotations

from typing import Any

import pytest

from tactibench.plugins import PluginHost
from tactibench.protocols import protocol_files


@pytest.fixture(scope="module")
def host() -> PluginHost:
    return PluginHost()


def test_list_names_everything_that_is_installed(cli: Any, host: PluginHost) -> None:
    code, out, err = cli("list")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    for catalogue in host.catalogues:
        assert f"{catalogue.kind}s:" in lines
        for spec in catalogue:
            assert any(line.split(maxsplit=1) == [spec.name, spec.summary] for line in lines)
    for name in protocol_files():
        assert any(line.startswith(f"  {name} ") for line in lines)


def test_describe_shows_every_spec_with_its_parameters(cli: Any, host: PluginHost) -> None:
    for catalogue in host.catalogues:
        for spec in catalogue:
            code, out, err = cli("describe", spec.name)
            assert (code, err) == (0, "")
            assert spec.target in out
            if hasattr(spec, "kind"):
                assert f"kind      {spec.kind}" in out
            if getattr(spec, "uses_encoder", False):
                assert f"encoder   of kind {' or '.join(spec.encoders)}" in out
                assert spec.default_encoder in out
            assert str(catalogue.origins[spec.name]) in out
            for parameter in spec.parameters:
                assert f"--param {catalogue.kind}.{parameter.name}={parameter.default}" in out
                assert parameter.help in out


def test_describe_shows_every_protocol_by_name_and_by_file(cli: Any) -> None:
    for name, file in protocol_files().items():
        code, out, err = cli("describe", name)
        assert (code, err) == (0, "")
        assert out.startswith(f"protocol {name}@")
        assert cli("describe", file)[1] == out
        assert " + \n" not in out
