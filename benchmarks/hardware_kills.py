"""SIGKILL of the collector at random moments: verb ``kills`` of ``hardware.py``."""

from __future__ import annotations

import json
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tactibench_tactip.plan import plan_of
from tactibench_tactip.settings import Settings, example_configuration


def run_kills(kills: int, count: int, seed: int, settings: Settings) -> None:
    """Kill the command at random moments; at the end every id must be there once.

    Args:
        kills: Number of kills.
        count: Number of presses.
        seed: Seed of the random moments.
        settings: Settings of the emulated robot, from which the presses are planned.
    """
    base = Path(tempfile.mkdtemp(prefix="tactibench-kills-"))
    config = base / "lab.toml"
    text = example_configuration("grbl").replace(
        'method = "visual"', 'method = "fixed"\nfixed_mm = 0.8'
    )
    config.write_text(text.replace("pins = 127", "# pins = 127"), encoding="utf-8")
    out, presses = base / "data", base / "presses.jsonl"
    plan = plan_of("exp1", settings, draws=("singles",), count=count)
    presses.write_text("".join(json.dumps(row) + "\n" for row in plan.rows()), encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "tactibench",
        "hw",
        "collect",
        str(presses),
        "--config",
        str(config),
        "--out",
        str(out),
        "--emulate",
        "--time-scale",
        "100",
    ]
    rng = random.Random(seed)  # noqa: S311
    killed, counts = 0, []
    while True:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        if killed >= kills:
            process.wait()
            break
        _wait_for_growth(out, process, rng)
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
            process.wait()
            killed += 1
        counts.append(len(_ids(out)))
        if counts[-1] == count:
            break
    ids = _ids(out)
    print(f"{killed} kills; rows after each: {counts}")
    good = sorted(ids) == sorted(press.id for press in plan.presses)
    print(f"ids: {len(ids)} of {count}: {'exactly the planned' if good else 'WRONG'}")
    verified = subprocess.run(
        [sys.executable, "-m", "tactibench", "data", "verify", str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    print(verified.stdout.strip())
    shutil.rmtree(base, ignore_errors=True)


def _wait_for_growth(out: Path, process: subprocess.Popen[bytes], rng: random.Random) -> None:
    """Wait for a random moment: at the start, or shortly after one to three rows were written."""
    before, wanted = len(_ids(out)), rng.randint(0, 3)
    while process.poll() is None and len(_ids(out)) < before + wanted:
        time.sleep(0.01)
    time.sleep(rng.uniform(0.0, 1.5 if wanted == 0 else 0.15))


def _ids(out: Path) -> list[int]:
    try:
        lines = (out / "metadata.jsonl").read_bytes().split(b"\n")[:-1]
    except OSError:
        return []
    return [json.loads(line)["id"] for line in lines]
