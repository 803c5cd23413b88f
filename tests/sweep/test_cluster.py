"""Results in the order of the items, never far ahead of who takes them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tactibench.errors import UserError
from tactibench.run import software
from tactibench.sweep import NO_GPU, Capacity, Cluster, Storage, check_workers
from tactibench.sweep.cluster import _WorkerView

pytest.importorskip("distributed", reason="the engine of sweeps is an extra of its own")


class Client:
    """Does every task at once."""

    def __init__(self, *workers: dict[str, int]) -> None:
        self.status = "running"
        self.info = {f"tcp://{n}": {"nthreads": 1, "resources": w} for n, w in enumerate(workers)}
        self.begun = 0
        self.cancelled: list[Any] = []

    def scheduler_info(self, n_workers: int) -> dict[str, Any]:
        assert n_workers == -1
        return {"workers": self.info}

    def submit(self, work: Any, *given: Any, **_: Any) -> Any:
        self.begun += 1
        return SimpleNamespace(result=lambda: work(*given), done=lambda: True)

    def run(self, work: Any, *given: Any, on_error: str) -> dict[str, Any]:
        assert on_error == "return"
        return {address: work(*given) for address in self.info}

    def cancel(self, futures: list[Any]) -> None:
        self.cancelled = futures


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("distributed.wait", lambda *_, **__: None)


@pytest.mark.parametrize("workers", [0, 1, 3])
@pytest.mark.parametrize("count", [0, 1, 2, 7, 8, 40])
def test_every_item_once_and_in_order(workers: int, count: int) -> None:
    engine = Cluster(Client(*[{}] * workers), remote=False)
    assert list(engine.map_in_order(lambda n: n * n, range(count))) == [n * n for n in range(count)]
    assert engine.client.begun == count


def test_not_far_ahead_and_the_rest_is_cancelled() -> None:
    engine = Cluster(Client({}, {}), remote=False)
    results = engine.map_in_order(lambda n: n, range(1000))
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    assert engine.client.begun == 2 + 5
    results.close()  # type: ignore[attr-defined]
    assert len(engine.client.cancelled) == 4


def test_room() -> None:
    client = Client({"GPU": 1}, {}, {})
    assert Cluster(client, remote=False).capacity() == Capacity(3, 1)
    assert Cluster(client, remote=True).capacity().slots > 1000, "its workers come and go"
    assert Cluster(Client({}), remote=True).capacity().gpus == 0
    assert Cluster(Client(), remote=True).capacity().gpus > 0, "nobody has come yet"
    assert "--resources GPU=1" in NO_GPU


@pytest.mark.parametrize("name", ["tactibench", "numpy", "torch", "plugin unet", "plugin more"])
def test_a_worker_with_other_software_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    engine = Cluster(Client({}), remote=True)
    storage = Storage(tmp_path / "runs", tmp_path / "cache", any_machine=True)
    check_workers(engine, storage)
    other = _WorkerView((), {**software(), name: "9.9"})
    monkeypatch.setattr("tactibench.sweep.cluster._view_worker", lambda _: other)
    with pytest.raises(UserError, match=f"has {name} 9.9, this machine has {name} .*install the"):
        check_workers(engine, storage)


def test_a_scheduler_that_has_gone() -> None:
    client = Client({})
    client.status = "closed"
    with pytest.raises(UserError, match="connection to the scheduler was lost"):
        Cluster(client, remote=True).wait_any([SimpleNamespace(done=lambda: False)])
