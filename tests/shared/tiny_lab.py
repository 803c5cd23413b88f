"""Commands in a laboratory so small that each takes a fraction of a second, in forked processes.

A fork has everything imported, so that hundreds of commands can be stopped and called again. Its
protocols have few presses, its sensor has twenty pixels, its model one weight.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from briefly import time_briefly
from few_presses import few_presses

sys.path.insert(0, str(Path(__file__).parents[1] / "run" / "fake"))

OUTPUT = "output.txt"
CRASHED = 70
"""Exit code of a child whose command let an exception through: a traceback, for a user."""


def tiny_host(*_: Any, **__: Any) -> Any:
    """What a host offers to commands: one sensor and one model."""
    from tactibench import ModelSpec, Parameter, SensorSpec
    from tactibench.plugins import Catalogue, Origin

    origin = Origin("tiny", "tiny-tactile", "1.0")

    def catalogue(kind: str, *specs: Any) -> Catalogue[Any]:
        names = {spec.name: spec for spec in specs}
        return Catalogue(kind, names, dict.fromkeys(names, origin), {})

    epochs = Parameter("epochs", 6, "passes", low=1)
    model = ModelSpec("tiny", "tiny_tactile.trained:TrainedModel", "linear", (epochs,))
    sensor = SensorSpec("tactip-127", "tiny_tactile.parts:TinySensor", "twenty pixels")
    kinds = {
        "model": catalogue("model", model),
        "sensor": catalogue("sensor", sensor),
        "encoder": catalogue("encoder"),
    }
    return SimpleNamespace(
        **{f"{kind}s": entries for kind, entries in kinds.items()},
        catalogues=tuple(kinds.values()),
        catalogue=kinds.__getitem__,
        plugins=(origin,),
        commands=catalogue("command"),
        problems=(),
    )


def tiny_commands(put: Callable[[Any, str, Any], None], protocols: Path) -> None:
    """Have commands of this process find the tiny plugins and the protocols in a folder.

    put: ``setattr``, or that of a patch, which takes everything back.
    """
    from tactibench import plugins
    from tactibench.datasets import generation
    from tactibench.frames import cache as generated
    from tactibench.plugins import host
    from tactibench.protocols import loader

    shipped = loader.shipped_folder
    put(generated, "CHUNK", 16)  # several chunks of 60 presses
    time_briefly(put)
    put(loader, "shipped_folder", lambda name: protocols if name == "protocols" else shipped(name))
    put(host, "PluginHost", tiny_host)
    put(plugins, "PluginHost", tiny_host)  # a facade keeps what it has found
    put(generation, "PluginHost", tiny_host)


class Lab:
    """folder: of the protocols. Commands run in folders of their own, with a cache there.

    prefix: of the protocols' ids; without one they stand for those that ship.
    """

    def __init__(self, folder: Path, prefix: str = "") -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.protocols = folder / "protocols"
        if not self.protocols.is_dir():
            few_presses(self.protocols, prefix)

    def fork(
        self, where: Path, arguments: tuple[str, ...], before: Callable[[], None] | None = None
    ) -> int:
        """Begin a command in a folder and return its process. before: called in it first."""
        sys.stdout.flush()
        child = os.fork()
        if child:
            return child
        code = CRASHED
        try:
            code = self._command(where, arguments, before)
        except BaseException:  # noqa: BLE001 - a fork must not run on as its parent
            traceback.print_exc()
        finally:
            sys.stderr.flush()
            sys.stdout.flush()
            os._exit(code)

    def wait(self, child: int) -> int:
        """Exit code, negative for a signal."""
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

    def run(
        self, where: Path, arguments: tuple[str, ...], before: Callable[[], None] | None = None
    ) -> tuple[int, str]:
        """Exit code and output of a command."""
        code = self.wait(self.fork(where, arguments, before))
        return code, (where / OUTPUT).read_text(encoding="utf-8", errors="replace")

    def preload(self, where: Path, *commands: tuple[str, ...]) -> None:
        """Import here what commands import, so that their forks need not."""
        for arguments in commands:
            code, output = self.run(where, arguments, lambda: _tell_modules(where))
            if code:
                raise RuntimeError(f"{arguments} ended with {code}:\n{output}")
            for name in (where / "modules.txt").read_text().split():
                if name not in sys.modules and name != "__main__":
                    with suppress(Exception):  # it only costs time
                        import_module(name)
            (where / "modules.txt").unlink()

    def _command(
        self, where: Path, arguments: tuple[str, ...], before: Callable[[], None] | None
    ) -> int:
        from tactibench.cli.main import call
        from tactibench.report import run_pictures

        os.chdir(where)
        os.environ["TACTIBENCH_CACHE"] = str(where / "cache")
        file = os.open(where / OUTPUT, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        os.dup2(file, 1)
        os.dup2(file, 2)
        sys.stdout = os.fdopen(1, "w", encoding="utf-8", closefd=False)
        sys.stderr = os.fdopen(2, "w", encoding="utf-8", closefd=False)
        tiny_commands(setattr, self.protocols)
        run_pictures.update_pictures = lambda *_: []  # the records are there before their pictures
        if before is not None:
            before()
        return call(arguments)


def _tell_modules(where: Path) -> None:
    """Have this process write what it has imported when its command is done."""
    end = os._exit

    def told(code: int) -> None:
        (where / "modules.txt").write_text("\n".join(sys.modules))
        end(code)

    os._exit = told  # type: ignore[assignment]
