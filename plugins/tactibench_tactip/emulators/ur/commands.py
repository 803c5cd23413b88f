"""The commands of the control script, by number."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from tactibench_tactip.emulators.poses import from_ur, to_ur
from tactibench_tactip.emulators.ur import kinematics
from tactibench_tactip.emulators.ur.contact import Contact

if TYPE_CHECKING:
    from tactibench_tactip.emulators.ur.script import Script


STEP_S = 0.002


def carry_out(script: Script, command: int) -> None:
    """One command. What is not known is answered as done, and said in a message."""
    known = COMMANDS.get(command)
    if known is None:
        script.controller.messages.append(f"command {command} is not emulated; nothing happens")
        return
    known(script)


def _run(script: Script) -> None:
    """A motion has begun: wait for it, or report that an asynchronous one runs."""
    if script.whole(1) == 1:
        script.start()
    else:
        script.wait(lambda now: not script.controller.arm.moving(now))


def _move_joints(script: Script) -> None:
    script.finish()
    arm = script.controller.arm
    arm.move_joints(script.t, script.reals(0), script.real(6), script.real(7))
    _run(script)


def _move_line(script: Script) -> None:
    script.finish()
    script.controller.arm.move(script.t, script.reals(0), script.real(6), script.real(7))
    _run(script)


def _move_joints_to_pose(script: Script) -> None:
    script.finish()
    arm = script.controller.arm
    q = arm.reachable(script.reals(0))
    if q is None:
        script.controller.messages.append("get_inverse_kin found no solution")
        script.controller.end_program(script.t)
        return
    arm.move_joints(script.t, q.tolist(), script.real(6), script.real(7))
    _run(script)


def _stop(script: Script) -> None:
    script.finish()
    script.controller.arm.stop(script.t, script.real(0))
    _run(script)


def _speed(script: Script) -> None:
    """A realtime command: it stays in its register, and is read in every turn of the loop."""
    wanted = (*script.reals(0), script.real(6))
    if script.pushing != wanted or not script.controller.arm.moving(script.t):
        script.controller.arm.push(script.t, wanted[:6], wanted[6])
        script.pushing = wanted


def _speed_stop(script: Script) -> None:
    script.pushing = ()
    script.controller.arm.stop(script.t, script.real(0))
    script.wait(lambda now: not script.controller.arm.moving(now))


def _set_tcp(script: Script) -> None:
    script.controller.arm.tcp = from_ur(script.reals(0))


def _set_payload(script: Script) -> None:
    script.controller.payload = script.real(0)


def _protective_stop(script: Script) -> None:
    script.controller.protective_stop(script.t)


def _nothing(script: Script) -> None:
    """Zeroing a force sensor that has no offset; and the like."""


def _watchdog(script: Script) -> None:
    script.watchdog(script.real(0))


def _safe_pose(script: Script) -> None:
    script.answer(int(script.controller.arm.reachable(script.reals(0)) is not None))


def _tcp_offset(script: Script) -> None:
    script.answers(to_ur(script.controller.arm.tcp).tolist())


def _flange_pose(script: Script) -> None:
    script.answers(to_ur(script.controller.arm.flange(script.t)).tolist())


def _forward(script: Script) -> None:
    script.answers(script.controller.arm.pose(script.t).tolist())


def _forward_of(script: Script) -> None:
    end = kinematics.flange(np.array(script.reals(0))) @ from_ur(script.reals(6))
    script.answers(to_ur(end).tolist())


def _inverse(script: Script) -> None:
    q = script.controller.arm.reachable(script.reals(0))
    if q is None:
        script.controller.messages.append("get_inverse_kin found no solution")
        script.controller.end_program(script.t)
    else:
        script.answers(q.tolist())


def _trans(script: Script) -> None:
    script.answers(to_ur(from_ur(script.reals(0)) @ from_ur(script.reals(6))).tolist())


def _step_time(script: Script) -> None:
    script.answers([STEP_S])


def _steady(script: Script) -> None:
    script.answer(int(script.controller.arm.steady(script.t)))


def _until_contact(script: Script) -> None:
    """51: a CB3 controller gets a script without the lines that do it, and answers as if it had."""
    if script.controller.is_cb3:
        return
    contact = Contact(script)
    script.controller.arm.push(script.t, script.reals(0), script.real(12))
    arm = script.controller.arm
    script.wait(
        lambda now: (contact.seen and arm.steady(now)) or not arm.moving(now),
        lambda _: contact.end(),
    )


def _start_contact(script: Script) -> None:
    if script.contact is not None:
        script.contact.end()
    script.contact = Contact(script) if not script.controller.is_cb3 else None


def _stop_contact(script: Script) -> None:
    _read_contact(script)
    script.release()


def _read_contact(script: Script) -> None:
    script.answer(int(script.contact is not None and script.contact.seen))


COMMANDS: dict[int, Callable[[Script], None]] = {
    1: _move_joints,
    2: _move_joints_to_pose,
    3: _move_line,
    8: _nothing,
    10: _speed,
    15: _speed_stop,
    17: _set_payload,
    26: _step_time,
    29: _set_tcp,
    30: _inverse,
    31: _protective_stop,
    33: _stop,
    34: _stop,
    35: _watchdog,
    36: _safe_pose,
    39: _trans,
    40: _tcp_offset,
    43: _forward,
    44: _forward_of,
    46: _inverse,
    47: _steady,
    51: _until_contact,
    58: _flange_pose,
    60: _safe_pose,
    61: _safe_pose,
    62: _start_contact,
    63: _stop_contact,
    64: _read_contact,
    65: _set_payload,
}
