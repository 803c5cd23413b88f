"""Plugins that are installed as far as Python can tell."""

from __future__ import annotations

from pathlib import Path


def fake_distribution(site: Path, name: str, *, version: str = "1.0", **plugins: str) -> Path:
    """Write what an installer writes about a distribution beside its modules; its folder.

    plugins: name -> module of the hooks. Further plugins of a distribution that is there are added.
    """
    info = site / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True, exist_ok=True)
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n\nName: not this\n",
        encoding="utf-8",
    )
    with (info / "entry_points.txt").open("a", encoding="utf-8") as file:
        file.writelines(f"[tactibench]\n{plugin} = {hooks}\n" for plugin, hooks in plugins.items())
    return info
