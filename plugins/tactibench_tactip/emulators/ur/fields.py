"""The fields that RTDE offers, with their types, and what the emulator puts into them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tactibench_tactip.emulators.ur.controller import REGISTERS, Controller

Getter = Callable[[Controller], Any]

_ZEROS = (0.0,) * 6


def _constant(value: Any) -> Getter:
    return lambda _: value


def _whole(number: int) -> Getter:
    return lambda c: c.out_int[number]


def _real(number: int) -> Getter:
    return lambda c: c.out_double[number]


OUTPUTS: dict[str, tuple[str, Getter]] = {
    "timestamp": ("DOUBLE", lambda c: c.t),
    "actual_TCP_pose": ("VECTOR6D", lambda c: c.arm.pose(c.t)),
    "target_TCP_pose": ("VECTOR6D", lambda c: c.arm.pose(c.t)),
    "actual_TCP_speed": ("VECTOR6D", lambda c: c.arm.velocity(c.t)),
    "target_TCP_speed": ("VECTOR6D", lambda c: c.arm.velocity(c.t)),
    "actual_TCP_force": ("VECTOR6D", lambda c: c.arm.force(c.t)),
    "ft_raw_wrench": ("VECTOR6D", lambda c: c.arm.force(c.t)),
    "actual_q": ("VECTOR6D", lambda c: c.arm.joints(c.t)),
    "target_q": ("VECTOR6D", lambda c: c.arm.joints(c.t)),
    "robot_mode": ("INT32", lambda c: c.robot_mode),
    "safety_mode": ("INT32", lambda c: c.safety_mode),
    "safety_status": ("INT32", lambda c: c.safety_mode),
    "runtime_state": ("UINT32", lambda c: c.runtime_state),
    "robot_status_bits": ("UINT32", lambda c: c.status_bits),
    "safety_status_bits": ("UINT32", lambda c: c.safety_bits),
    "payload": ("DOUBLE", lambda c: c.payload),
    "joint_mode": ("VECTOR6INT32", _constant((253,) * 6)),
    "joint_temperatures": ("VECTOR6D", _constant((30.0,) * 6)),
    "actual_joint_voltage": ("VECTOR6D", _constant((48.0,) * 6)),
    "actual_tool_accelerometer": ("VECTOR3D", _constant((0.0, 0.0, -9.81))),
    "payload_cog": ("VECTOR3D", _constant((0.0,) * 3)),
    "speed_scaling": ("DOUBLE", _constant(1.0)),
    "target_speed_fraction": ("DOUBLE", _constant(1.0)),
    "actual_main_voltage": ("DOUBLE", _constant(48.0)),
    "actual_robot_voltage": ("DOUBLE", _constant(48.0)),
    **{
        name: ("VECTOR6D", _constant(_ZEROS))
        for name in (
            "target_qd",
            "target_qdd",
            "target_current",
            "target_moment",
            "actual_qd",
            "actual_current",
            "actual_current_as_torque",
            "joint_control_output",
            "payload_inertia",
        )
    },
    **{
        name: ("DOUBLE", _constant(0.0))
        for name in (
            "actual_execution_time",
            "actual_momentum",
            "actual_robot_current",
            "standard_analog_input0",
            "standard_analog_input1",
            "standard_analog_output0",
            "standard_analog_output1",
            "tcp_force_scalar",
        )
    },
    **{
        name: ("UINT64", _constant(0))
        for name in ("actual_digital_input_bits", "actual_digital_output_bits")
    },
    **{
        name: ("UINT32", _constant(0))
        for name in (
            "output_bit_registers0_to_31",
            "output_bit_registers32_to_63",
            "tool_output_mode",
        )
    },
    **{f"output_int_register_{k}": ("INT32", _whole(k)) for k in range(REGISTERS)},
    **{f"output_double_register_{k}": ("DOUBLE", _real(k)) for k in range(REGISTERS)},
}
"""Name -> type, how to get its value. What the world does not know is constant."""

INPUTS: dict[str, str] = {
    **{f"input_int_register_{k}": "INT32" for k in range(REGISTERS)},
    **{f"input_double_register_{k}": "DOUBLE" for k in range(REGISTERS)},
    **{f"input_bit_register_{k}": "BOOL" for k in range(64, 128)},
    "input_bit_registers0_to_31": "UINT32",
    "input_bit_registers32_to_63": "UINT32",
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "standard_digital_output_mask": "UINT8",
    "standard_digital_output": "UINT8",
    "configurable_digital_output_mask": "UINT8",
    "configurable_digital_output": "UINT8",
    "tool_digital_output_mask": "UINT8",
    "tool_digital_output": "UINT8",
    "standard_analog_output_mask": "UINT8",
    "standard_analog_output_type": "UINT8",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
    "external_force_torque": "VECTOR6D",
}
