"""The load of the machine while something is timed: stolen time, and work of other processes.

Linux counts in ``/proc/stat`` what each processor did, in ticks of usually 10 ms; time that a
hypervisor gave to other machines is "steal". Work that is not of this process is *foreign*. Other
systems have no such counters: every share is then None, not known.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

QUIET = 0.1
"""Largest share of processor time that may be stolen or foreign, and largest share by which
processor and wall time of one thread may differ: beyond it a median moves by more than the seeds of
one model differ."""
WINDOW_S = 0.2
"""Seconds below which no share is known: a tick of each processor would count 5 % or more."""

_STAT = Path("/proc/stat")


@dataclass(frozen=True)
class Counters:
    """Seconds since the start of the machine, summed over the processors that this process may use.

    Attributes:
        busy_s: Time in which any process computed, s.
        stolen_s: Time in which a hypervisor computed for other machines, s.
        total_s: All time, idle time included, s.
        processors: Number of processors.
        own_s: Time in which this process computed, s.
    """

    busy_s: float
    stolen_s: float
    total_s: float
    processors: int
    own_s: float


@dataclass(frozen=True)
class Load:
    """The load while something was timed.

    Attributes:
        stolen: Share of the processors' time that a hypervisor took; None where it is not known.
        foreign: Share in which other processes computed, children of this process among them; None
            where it is not known.
        average: Load average of the last minute, at the end; None where it is not known.
    """

    stolen: float | None = None
    foreign: float | None = None
    average: float | None = None

    @property
    def others(self) -> float | None:
        """Return the share that was stolen or foreign; None where it is not known."""
        if self.stolen is None or self.foreign is None:
            return None
        return self.stolen + self.foreign

    @property
    def quiet(self) -> bool | None:
        """Return whether the stolen and foreign share is small; None where it is not known."""
        return None if self.others is None else self.others <= QUIET


Counter = Callable[[], Counters | None]


def counters(
    processor: Callable[[], float] = time.process_time, path: Path = _STAT
) -> Counters | None:
    """Return the present counters; None where the system has none.

    Args:
        processor: Returns the processor time of this process, s.
        path: The file /proc/stat.
    """
    own_s = processor()
    try:
        text = path.read_text(encoding="ascii", errors="replace")
        cpus = os.sched_getaffinity(0)
        tick_s = 1 / os.sysconf("SC_CLK_TCK")
    except (OSError, AttributeError, ValueError):
        return None
    return parse_stat(text, cpus, own_s, tick_s)


def parse_stat(text: str, cpus: Collection[int], own_s: float, tick_s: float) -> Counters | None:
    """Return the counters in the text of /proc/stat; None for a text without these processors.

    The columns are user, nice, system, idle, iowait, irq, softirq, steal; the guests that follow
    are counted in user and nice already (proc(5)).

    Args:
        text: Text of /proc/stat.
        cpus: Numbers of the processors that are counted.
        own_s: Processor time of this process, s.
        tick_s: Duration of a tick, s.
    """
    busy, stolen, total, count = 0, 0, 0, 0
    for line in text.splitlines():
        name, *fields = line.split()
        if not name.startswith("cpu") or not name[3:].isdigit() or int(name[3:]) not in cpus:
            continue
        user, nice, system, idle, waiting, irq, soft, steal = map(int, [*fields, *"00000000"][:8])
        computed = user + nice + system + irq + soft
        busy, stolen = busy + computed, stolen + steal
        total += computed + steal + idle + waiting
        count += 1
    if not count:
        return None
    return Counters(tick_s * busy, tick_s * stolen, tick_s * total, count, own_s)


def load_between(before: Counters | None, after: Counters | None) -> Load:
    """Return the load between two moments; its shares are None where they cannot be known."""
    average = load_average()
    if before is None or after is None or before.processors != after.processors:
        return Load(average=average)
    total = after.total_s - before.total_s
    if total < WINDOW_S * after.processors:
        return Load(average=average)
    own_s = after.own_s - before.own_s
    foreign = max(0.0, after.busy_s - before.busy_s - own_s)
    stolen = max(0.0, after.stolen_s - before.stolen_s)
    return Load(min(stolen / total, 1.0), min(foreign / total, 1.0), average)


def load_average() -> float | None:
    """Return the load average of the last minute; None where the system has none."""
    try:
        return round(os.getloadavg()[0], 2)
    except (OSError, AttributeError):
        return None


def machine_load(
    seconds: float = 2.0,
    *,
    sleep: Callable[[float], None] = time.sleep,
    counter: Counter = counters,
) -> Load:
    """Return the load of the machine while this process waits.

    Args:
        seconds: Time to wait, s.
        sleep: Function that waits.
        counter: Function that returns the present counters.
    """
    before = counter()
    sleep(seconds)
    return load_between(before, counter())
