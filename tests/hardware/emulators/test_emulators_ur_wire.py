"""RTDE, byte by byte: versions 1 and 2, recipes, split packages, refusals."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ur_bench import UrBench

from tactibench_tactip.emulators.ur import wire
from tactibench_tactip.emulators.ur.rtde import RtdeSession

DOUBLE = struct.pack(">d", 125.0)
REQUEST = wire.packed(wire.VERSION, struct.pack(">H", 2))


class Free:
    """Nobody else writes inputs."""

    def __init__(self, *taken: str) -> None:
        self._taken = set(taken)

    def taken(self, name: str, by: object) -> bool:
        return name in self._taken

    def take(self, name: str, by: object) -> None: ...


def session(*taken: str, version: tuple[int, ...] = (5, 12, 2, 1)) -> RtdeSession:
    bench = UrBench(version=version)
    return RtdeSession(bench.ur, Free(*taken))


def answers(ours: RtdeSession, kind: int, payload: bytes) -> list[tuple[int, bytes]]:
    return list(wire.Splitter().feed(ours.feed(wire.packed(kind, payload), 0.0)))


def test_version_and_control_version() -> None:
    ours = session()
    assert answers(ours, wire.VERSION, struct.pack(">H", 2)) == [(ord("V"), b"\x01")]
    assert answers(ours, wire.VERSION, struct.pack(">H", 7)) == [(ord("V"), b"\x00")]
    (reply,) = answers(ours, wire.URCONTROL, b"")
    assert struct.unpack(">4I", reply[1]) == (5, 12, 2, 1)


def test_outputs_are_packed_in_the_order_asked_for() -> None:
    ours = session()
    ours.feed(REQUEST, 0.0)
    names = b"output_int_register_1,timestamp,robot_mode,actual_TCP_pose,"
    (reply,) = answers(ours, wire.OUTPUTS, DOUBLE + names)
    assert reply[1] == b"\x01INT32,DOUBLE,INT32,VECTOR6D"
    assert ours.hertz == 125.0
    ((_, data),) = wire.Splitter().feed(ours.sample())
    assert data[0] == 1
    found = wire.unpack_values(["INT32", "DOUBLE", "INT32", "VECTOR6D"], data[1:])
    assert found[:3] == [0, 0.0, 7]
    assert len(found[3]) == 6


def test_version_1_has_no_recipe_number_and_no_rate() -> None:
    ours = session()
    (reply,) = answers(ours, wire.OUTPUTS, b"timestamp,robot_mode")
    assert reply[1] == b"DOUBLE,INT32"
    assert ours.hertz == 125.0
    ((_, data),) = wire.Splitter().feed(ours.sample())
    assert wire.unpack_values(["DOUBLE", "INT32"], data) == [0.0, 7]


def test_a_cb3_streams_at_most_125_times_a_second() -> None:
    ours = session(version=(3, 15, 0, 1))
    ours.feed(REQUEST, 0.0)
    ours.feed(wire.packed(wire.OUTPUTS, struct.pack(">d", 500.0) + b"timestamp"), 0.0)
    assert ours.hertz == 125.0


def test_what_is_not_known_or_not_free_is_said() -> None:
    ours = session("input_int_register_3")
    ours.feed(REQUEST, 0.0)
    (reply,) = answers(ours, wire.OUTPUTS, DOUBLE + b"timestamp,nonsense")
    assert reply[1].endswith(b"DOUBLE,NOT_FOUND")
    assert answers(ours, wire.START, b"") == [(ord("S"), b"\x00")]
    (reply,) = answers(ours, wire.INPUTS, b"input_int_register_0,input_int_register_3")
    assert reply[1] == b"\x00INT32,IN_USE"
    for number in (1, 2, 3):
        (reply,) = answers(ours, wire.INPUTS, b"input_int_register_0,input_double_register_1,")
        assert reply[1] == bytes([number]) + b"INT32,DOUBLE"


def test_start_and_pause() -> None:
    ours = session()
    ours.feed(REQUEST, 0.0)
    ours.feed(wire.packed(wire.OUTPUTS, DOUBLE + b"timestamp"), 0.0)
    assert answers(ours, wire.START, b"") == [(ord("S"), b"\x01")]
    assert ours.streaming
    assert answers(ours, wire.PAUSE, b"") == [(ord("P"), b"\x01")]
    assert not ours.streaming


def test_an_input_package_writes_its_registers() -> None:
    bench = UrBench()
    ours = RtdeSession(bench.ur, Free())
    ours.feed(wire.packed(wire.INPUTS, b"input_double_register_4,input_int_register_0"), 0.0)
    values = wire.pack_values(["DOUBLE", "INT32"], [0.25, -7])
    ours.feed(wire.packed(wire.DATA, b"\x01" + values), 0.0)
    assert bench.ur.inputs == {"input_double_register_4": 0.25, "input_int_register_0": -7}


@pytest.mark.parametrize(
    "data",
    [
        wire.packed(wire.DATA, b"\x05abc"),
        wire.packed(wire.DATA, b""),
        wire.packed(wire.VERSION, b"\x00"),
        wire.HEADER.pack(2, wire.VERSION),
        wire.packed(wire.OUTPUTS, b"x" * 2049),
    ],
)
def test_what_is_no_rtde_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"package|names|bytes"):
        session().feed(data, 0.0)


def test_text_messages_of_both_versions() -> None:
    (second,) = wire.Splitter().feed(wire.text_message(2, "hello", "me", 3))
    assert second == (ord("M"), b"\x05hello\x02me\x03")
    (first,) = wire.Splitter().feed(wire.text_message(1, "hello", "me", 3))
    assert first == (ord("M"), b"\x03hello")
    (reply,) = answers(session(), ord("Z"), b"")
    assert reply[0] == wire.TEXT
    bench = UrBench()
    RtdeSession(bench.ur, Free()).feed(wire.packed(wire.TEXT, b"\x02hi\x00\x03"), 0.0)
    assert "hi" in bench.ur.messages[0]


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 255), st.binary(max_size=40))), st.data())
def test_packages_come_out_whole_however_the_bytes_come_in(
    packages: list[tuple[int, bytes]], data: st.DataObject
) -> None:
    stream = b"".join(wire.packed(kind, payload) for kind, payload in packages)
    splitter, found, at = wire.Splitter(), [], 0
    while at < len(stream):
        step = data.draw(st.integers(1, len(stream) - at))
        found += list(splitter.feed(stream[at : at + step]))
        at += step
    assert found == packages


@settings(max_examples=40, deadline=None)
@given(st.lists(st.sampled_from(["BOOL", "UINT8", "UINT32", "INT32", "UINT64", "DOUBLE"])))
def test_values_are_packed_and_unpacked(types: list[str]) -> None:
    values = [True if kind == "BOOL" else 7 for kind in types]
    assert wire.unpack_values(types, wire.pack_values(types, values)) == values
    vectors = ["VECTOR3D", "VECTOR6D", "VECTOR6INT32", "VECTOR6UINT32"]
    rows = [(1.0, 2.0, 3.0), (1.0,) * 6, (-1,) * 6, (1,) * 6]
    packed = wire.pack_values(vectors, rows)
    assert len(packed) == 24 + 48 + 24 + 24
    assert wire.unpack_values(vectors, packed) == rows
