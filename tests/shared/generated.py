"""Sets of generated frames in a cache of a test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from tactibench.frames import GeneratedFrameSet, Presses
from tactibench.records import CacheEntry


def open_frames(
    frames: GeneratedFrameSet, cache: Path, advance: Callable[[int], None] = lambda _: None
) -> Presses:
    """Return the frames, from this cache where they are there."""
    return replace(frames, cache=cache).open(advance)


def entry_of(frames: GeneratedFrameSet, cache: Path) -> CacheEntry:
    """Return the place of the frames in this cache."""
    return replace(frames, cache=cache).entry
