"""Real clusters of processes on this machine, some of which are killed."""

from __future__ import annotations

import json
import os
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.request import urlopen

import pytest

from tactibench.plugins import PluginHost
from tactibench.records import CHECKSUM
from tactibench.sweep import Storage, list_cells, local_client, read_sweep, run_cell

for package in ("distributed", "cryptography"):
    pytest.importorskip(package, reason="the engine of sweeps is an extra of its own")

Command = Callable[..., subprocess.CompletedProcess[str]]
MEASURED = {"created", "environment", "speed", "timed", "efficiency", "training", "identity"}
"""Times, and what holds hashes of times."""


def records(store: Path) -> dict[str, Any]:
    found = [json.loads(path.read_text()) for path in sorted(store.glob("[!.]*/record.json"))]
    return {record["name"]: record for record in found}


def comparable(record: dict[str, Any]) -> dict[str, Any]:
    """All of a record that no clock has a part in."""
    stored = {k: v for k, v in record["identity"]["stored"].items() if k != "times"}
    same = {key: value for key, value in record.items() if key not in MEASURED}
    identity = {k: v for k, v in record["identity"].items() if k != CHECKSUM}  # covers the times
    return {**same, "identity": {**identity, "stored": stored}}


@pytest.mark.slow
def test_a_killed_worker_changes_nothing(
    asked: Callable[[str], Path], tactibench: Command, toy: Path, tmp_path: Path
) -> None:
    """The first process that trains "deaths=1" is killed by SIGKILL, and every one that trains
    "deaths=9"; the store is that of a serial run, but for the latter."""
    file = asked('model = ["toy", "toy, deaths=1", "toy, deaths=9", "toy-broken"]')
    options = ("--workers", "2", "--retries", "1", "--json", "rows.json", "--quiet")
    done = tactibench("sweep", file, *options)
    assert done.returncode == 1, done.stderr
    assert done.stderr == ""
    assert "8 cells: 4 run, 4 failed" in done.stdout
    assert done.stdout.count("the workers that ran it died one after the other") == 2
    raised = "plugin 'toy' (toy-tactile 1.0) raised ZeroDivisionError: no frames at all in Broken"
    assert " ".join(done.stdout.split()).count(raised) == 2
    begun = Counter(line.rpartition(" ")[0] for line in toy.read_text().splitlines())
    assert begun == {"Toy 0": 1, "Toy 1": 2, "Toy 9": 2}, "shared weights are trained once"

    rows = json.loads((tmp_path / "rows.json").read_text())
    failed = [row for row in rows if row["metric"] == "failed"]
    assert {row["model"] for row in failed} == {"toy, deaths=9", "toy-broken"}
    assert {row["run"] for row in rows if row["metric"] != "failed"} == set(records(Path("runs")))

    place = Storage(tmp_path / "serial", tmp_path / "other cache")
    toy.write_text("Toy 1 0\n")  # nobody dies again
    for cell in list_cells(read_sweep(file), PluginHost()):
        if cell.axes["model"] in ("toy", "toy, deaths=1"):
            assert run_cell(cell.request, place).why == ""
    parallel, serial = records(tmp_path / "runs"), records(tmp_path / "serial")
    assert len(parallel) == 4
    assert {name: comparable(one) for name, one in parallel.items()} == {
        name: comparable(one) for name, one in serial.items()
    }

    again = tactibench("sweep", asked('model = ["toy", "toy, deaths=1"]'), "--quiet")
    assert (again.returncode, again.stderr) == (0, "")
    assert "4 cells: 4 in the store" in again.stdout


@pytest.mark.long
def test_nobody_without_the_key_of_a_sweep_reaches_its_scheduler(toy: Path) -> None:
    from distributed import Security

    with local_client(1, 1, 0) as client:
        address = client.scheduler.address
        assert address.startswith("tls://127.0.0.1:")
        assert client.submit(os.getpid).result() != os.getpid()
        workers = client.scheduler_info(n_workers=-1)["workers"]
        assert all(name.startswith("tls://127.0.0.1:") for name in workers)
        folders = [Path(worker["local_directory"]) for worker in workers.values()]
        private = Path(os.environ["TACTIBENCH_CACHE"]).resolve() / "workers"
        assert all(folder.is_relative_to(private) for folder in folders)
        assert private.stat().st_mode & 0o077 == 0
        pages = [
            client.scheduler_info(n_workers=-1)["services"],
            *workers_services(workers),
        ]
        for services in pages:
            for path in ("info/main/workers.html", "json/identity.json", "proxy/1/x", "health"):
                with pytest.raises(HTTPError, match="404"):
                    urlopen(f"http://127.0.0.1:{services['dashboard']}/{path}", timeout=10)
        key = client.security.get_connection_args("client")["ssl_context"]
        other = Security.temporary().get_connection_args("client")["ssl_context"]
        nobody = ssl.create_default_context()
        nobody.check_hostname, nobody.verify_mode = False, ssl.CERT_NONE
        for each in (address, *workers):
            assert first_byte(each, key), "who has the key is greeted"
            for stranger in (other, nobody, None):
                assert first_byte(each, stranger) == b""


def workers_services(workers: Any) -> list[dict[str, int]]:
    return [worker["services"] for worker in workers.values() if worker["services"]]


def first_byte(address: str, context: ssl.SSLContext | None) -> bytes:
    """What a server says first; b"" where it refuses. context: None for no encryption at all."""
    host, _, port = address.removeprefix("tls://").rpartition(":")
    plain = socket.create_connection((host, int(port)), timeout=10)
    try:
        with plain if context is None else context.wrap_socket(plain) as connection:
            if context is None:
                connection.sendall(bytes(64))
            return connection.recv(1)
    except (ssl.SSLError, ConnectionError):
        return b""
    finally:
        plain.close()


def anybody_in(group: int) -> bool:
    """Return whether a process group has a process."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.long
def test_a_sweep_that_is_killed_half_way_is_continued(
    asked: Callable[[str], Path], tactibench: Command, toy: Path, tmp_path: Path
) -> None:
    """SIGKILL of its first process after the first cells: its workers end, too, the finished cells
    are not run again, and every other one is there once in the end."""
    file = asked('model = "toy"\nseed = [0, 1, 2, 3]')
    command = [sys.executable, "-m", "tactibench", "sweep", str(file), "--workers", "2"]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    try:
        end = time.monotonic() + 120
        while len(records(tmp_path / "runs")) < 2:
            assert process.poll() is None
            assert time.monotonic() < end
            time.sleep(0.02)
        process.kill()
        process.wait()
        while anybody_in(process.pid):
            assert time.monotonic() < end, "a worker outlived its sweep"
            time.sleep(0.02)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    kept = records(tmp_path / "runs")
    assert 2 <= len(kept) < 8
    done = tactibench("sweep", file, "--workers", "2", "--quiet")  # a busy machine shows progress
    assert (done.returncode, done.stderr) == (0, "")
    assert f"8 cells: {len(kept)} in the store, {8 - len(kept)} run;" in done.stdout
    final = records(tmp_path / "runs")
    assert len(final) == 8
    assert {name: final[name] for name in kept} == kept
