"""The source of frames that a request asks for; only its module is imported."""

from __future__ import annotations

from tactibench.frames.source import FrameRequest, FrameSource


def frame_source(request: FrameRequest) -> FrameSource:
    """Return the source that a request asks for.

    Raises:
        UserError: The sensor does not have the frames that the protocol asks for.
    """
    spec = request.spec
    if spec.transfer is not None:
        from tactibench.frames.transfer import TransferFrames

        return TransferFrames(request)
    if request.sensor.spec.needs_data:
        from tactibench.frames.recorded import recorded_source

        return recorded_source(request)
    if spec.families:
        from tactibench.frames.hard_cases import HardCaseFrames

        return HardCaseFrames(request)
    if request.reference:
        from tactibench.frames.reference import ReferenceFrames

        return ReferenceFrames(request)
    from tactibench.frames.drawn_presses import DrawnFrames

    return DrawnFrames(request)
