"""Lines that only look like a device: an echo, the same bytes for ever, answers recorded earlier, noise.

None is taken for a device, nor for an "off" that was confirmed, nor for a position or a voltage that was measured. An
adapter that hears itself with a device behind it works, or is refused by name.
"""

from __future__ import annotations

import time
from functools import partial
from random import Random
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fin_servo_driver import backends, robot_file
from fin_servo_driver.backends.backend import NOTHING
from fin_servo_driver.emulator.emulate import device_for
from fin_servo_driver.line import DeviceError, LineLostError, WrongDeviceError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from fin_servo_driver.backends.backend import Backend, Feedback
    from fin_servo_driver.emulator.devices import Device

ANSWERING = ("dynamixel", "firmata", "maestro", "modbus")
CONFIRMING = tuple(name for name, kind in backends.BACKENDS.items() if kind.confirms)
TRUSTING = tuple(sorted(backends.BACKENDS.keys() - set(ANSWERING)))


class Line:
    """A line without a port; time passes by the bytes and by waiting, so that no busy machine makes anything late.

    Attributes:
        answer: What comes back for what is written.
        echoes: Whether what is written comes back first.
    """

    now = 1000.0

    def __init__(self, answer: Callable[[bytes], bytes], first: bytes = b"", *, echoes: bool = False) -> None:
        self.answer = answer
        self.echoes = echoes
        self._waiting = first

    def write(self, data: bytes) -> None:
        Line.now += 0.0005
        self._waiting += data * self.echoes + self.answer(data)

    def read(self, timeout: float) -> bytes:
        if not self._waiting:
            Line.now += max(timeout, 1e-5)
        data, self._waiting = self._waiting, b""
        return data


SEEDS: list[int] = []
"""That were drawn from in this test: what was recorded in one session fits the questions of no other."""


@pytest.fixture(autouse=True)
def clock() -> Iterator[None]:
    """Let time pass on the line only, and let each test draw the same questions in each run.

    One order of a Maestro's ten questions in 252 fits what was recorded of another: drawn anew it would fail so often.
    """
    SEEDS.clear()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "monotonic", lambda: Line.now)
        patch.setattr(time, "sleep", lambda seconds: setattr(Line, "now", Line.now + seconds))
        yield


def backend_and_device(name: str) -> tuple[Backend, Device]:
    robot = robot_file.load(robot_file.find(name))
    backend = backends.make(robot)
    SEEDS.append(len(SEEDS))
    backend._random = Random(SEEDS[-1])  # type: ignore[attr-defined]  # noqa: S311
    return backend, device_for(robot, lambda _: 0.0)


def line_to(device: Device, *, echoes: bool = False) -> Line:
    """Return a line to a device whose port was just opened."""

    def answer(data: bytes) -> bytes:
        device.tick(Line.now)
        return device.feed(data, Line.now)

    return Line(answer, device.opened(Line.now), echoes=echoes)


def under_force(name: str) -> tuple[Backend, Device, Line]:
    """Return a back end, its device and the line between them, identified and enabled."""
    backend, device = backend_and_device(name)
    line = line_to(device)
    backend.identify(line)
    backend.disable(line)
    backend.enable(line, outputs(backend))
    return backend, device, line


def outputs(backend: Backend, part: float = 0.0) -> dict[int, float]:
    """Return a set-point, ``part`` of the way to each side."""
    if backend.robot.relays:
        return {
            channel: float(part > 0.0 and channel == joint.left)
            for joint in backend.robot.relays
            for channel in joint.channels
        }
    return {joint.channel: joint.centre + part * (joint.highest - joint.centre) for joint in backend.robot.servos}


def swim(backend: Backend, line: Line, ticks: int, start: int = 0) -> None:
    for number in range(start, start + ticks):
        Line.now += 1.0 / backend.rate
        backend.send(line, outputs(backend, float(np.sin(number / 20.0))))
        backend.read(line)


def hold(backend: Backend, line: Line, ticks: int) -> None:
    """Keep the tail to one side."""
    for _ in range(ticks):
        Line.now += 1.0 / backend.rate
        backend.send(line, outputs(backend, 0.5))
        backend.read(line)


def session(name: str) -> tuple[bytes, list[bytes]]:
    """Return what a real device said when its port was opened, and its answers, one for each write."""
    backend, device = backend_and_device(name)
    answers: list[bytes] = []
    first = device.opened(Line.now)

    def answer(data: bytes) -> bytes:
        device.tick(Line.now)
        answers.append(device.feed(data, Line.now))
        return answers[-1]

    line = Line(answer, first)
    backend.identify(line)
    backend.disable(line)
    backend.enable(line, outputs(backend))
    swim(backend, line, 30)
    backend.disable(line)
    return first, answers


def replay(answers: list[bytes], shift: int) -> Callable[[bytes], bytes]:
    """Return what answers one after another, whatever it is asked, from the start again at the end."""
    left: Iterator[bytes] = iter(())

    def answer(_: bytes) -> bytes:
        nonlocal left
        for recorded in left:
            return bytes(recorded)
        left = iter(answers[shift:] + answers[:shift])
        return bytes(next(left))

    return answer


def false_lines(name: str) -> dict[str, Callable[[], Line]]:
    """Return lines on which no device is, by what they do."""
    first, answers = session(name)
    told = sorted({answer for answer in answers if answer}, key=answers.index)
    made: dict[str, Callable[[], Line]] = {
        "silent": lambda: Line(lambda _: b""),
        "echo": lambda: Line(lambda _: b"", echoes=True),
        "echo after a banner": lambda: Line(lambda _: b"", first, echoes=True),
        "banner for ever": lambda: Line(lambda _: first or b"\x00", first),
    }
    for byte in (0x00, 0x01, 0xA1, 0xFF):
        for length in (1, 2, 8):
            made[f"{length} x {byte:02x}"] = partial(constant, bytes((byte,)) * length, first)
    made |= {f"answer {number}": partial(constant, recorded, first) for number, recorded in enumerate(told)}
    made |= {f"replay from {shift}": partial(replaying, answers, shift, first) for shift in range(8)}
    return made


def constant(data: bytes, first: bytes) -> Line:
    return Line(lambda _: data, first)


def replaying(answers: list[bytes], shift: int, first: bytes) -> Line:
    return Line(replay(answers, shift), first)


@pytest.mark.parametrize("name", ANSWERING)
def test_no_line_without_a_device_is_taken_for_one(name: str) -> None:
    for what, make in false_lines(name).items():
        backend, _ = backend_and_device(name)
        try:
            identity = backend.identify(make())
        except DeviceError:
            continue
        pytest.fail(f"{what} was taken for {identity}")


@pytest.mark.parametrize("name", ANSWERING)
def test_an_echo_is_refused_by_name(name: str) -> None:
    first, _ = session(name)
    backend, _ = backend_and_device(name)
    with pytest.raises(WrongDeviceError, match="only an echo of what was sent came back"):
        backend.identify(Line(lambda _: b"", first, echoes=True))


@pytest.mark.parametrize("name", CONFIRMING)
def test_no_line_without_a_device_confirms_that_it_is_off(name: str) -> None:
    for what, make in false_lines(name).items():
        backend, _, real = under_force(name)
        swim(backend, real, 3)
        false = make()
        real.answer, real.echoes = false.answer, false.echoes
        try:
            backend.disable(real)
        except DeviceError:
            continue
        pytest.fail(f"{what} was taken for a device that is off")


@pytest.mark.parametrize("name", TRUSTING)
def test_a_board_that_never_answers_confirms_and_measures_nothing(name: str) -> None:
    for make in false_lines(name).values():
        backend, _ = backend_and_device(name)
        line = make()
        assert "never answer" in backend.identify(line)
        backend.disable(line)
        assert backend.read(line) == NOTHING
    assert not backend.confirms
    assert not backend.measures


@pytest.mark.parametrize("name", sorted(backends.BACKENDS))
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), recorded=st.booleans())
def test_noise_is_no_device_and_confirms_and_measures_nothing(name: str, seed: int, *, recorded: bool) -> None:
    random = np.random.default_rng(seed)
    first, answers = session(name) if recorded else (b"", [b""])

    def answer(_: bytes) -> bytes:
        noise = random.bytes(int(random.integers(0, 9)))
        return noise + answers[int(random.integers(len(answers)))] if recorded and random.random() < 0.5 else noise

    backend, _ = backend_and_device(name)
    line = Line(answer, first)
    if name in TRUSTING:
        backend.identify(line)
    else:
        with pytest.raises(DeviceError):
            backend.identify(line)
    if backend.confirms:
        with pytest.raises(DeviceError):
            backend.disable(line)


@pytest.mark.parametrize("name", ["dynamixel", "modbus"])
def test_two_wires_that_hear_themselves_work_with_a_device_on_them(name: str) -> None:
    backend, device = backend_and_device(name)
    line = line_to(device, echoes=True)
    backend.identify(line)
    backend.disable(line)
    backend.enable(line, outputs(backend))
    swim(backend, line, 60)
    assert any(device.outputs.values())
    backend.disable(line)
    assert not any(device.outputs.values())
    device.feed = lambda *_: b""  # type: ignore[method-assign]  # its plug is drawn, the adapter goes on
    with pytest.raises(DeviceError):
        backend.disable(line)


@pytest.mark.parametrize("name", ["firmata", "maestro"])
def test_an_adapter_that_hears_itself_is_refused_where_both_ways_have_their_own_wires(name: str) -> None:
    backend, device = backend_and_device(name)
    with pytest.raises(WrongDeviceError, match="the adapter hears itself, which is supported on RS-485 only"):
        backend.identify(line_to(device, echoes=True))


@pytest.mark.parametrize("name", ["maestro", "modbus", "dynamixel"])
def test_a_device_that_starts_anew_under_a_gait_is_noticed(name: str) -> None:
    for ticks in range(1, 60, 7):
        backend, device, line = under_force(name)
        hold(backend, line, ticks + 5)
        assert any(device.outputs.values())
        device.lose_power()
        with pytest.raises(LineLostError, match="started anew"):
            hold(backend, line, 120)


@pytest.mark.parametrize("name", ["dynamixel", "firmata", "maestro", "modbus"])
def test_a_device_that_is_only_slow_or_loses_an_answer_is_not_lost(name: str) -> None:
    backend, _, line = under_force(name)
    answer, count = line.answer, 0

    def lossy(data: bytes) -> bytes:
        nonlocal count
        count += 1
        whole = answer(data)
        return b"" if count % 7 == 0 else whole

    line.answer = lossy
    swim(backend, line, 200)


@pytest.mark.parametrize("name", ["maestro", "modbus"])
def test_a_board_that_starts_anew_is_noticed_at_any_moment_of_its_force(name: str) -> None:
    for begin in range(5, 135, 3):
        backend, device, line = under_force(name)
        swim(backend, line, begin)
        while not any(device.outputs.values()):
            swim(backend, line, 1, begin)
            begin += 1  # noqa: PLW2901
        device.lose_power()
        with pytest.raises(LineLostError, match="started anew"):
            swim(backend, line, 120, begin)


def test_what_answers_something_else_than_a_servo_under_force_is_given_up_and_measures_nothing() -> None:
    for what, make in false_lines("dynamixel").items():
        backend, _, line = under_force("dynamixel")
        swim(backend, line, 5)
        false = make()
        line.answer, line.echoes = false.answer, false.echoes
        measured: list[Feedback] = []
        with pytest.raises(DeviceError):
            follow(backend, line, 3.0, measured)
        told = [feedback for feedback in measured if feedback != NOTHING]
        assert "replay" in what or len(told) <= 1, what


def follow(backend: Backend, line: Line, seconds: float, measured: list[Feedback]) -> None:
    begin = Line.now
    while Line.now - begin < seconds:
        backend.send(line, outputs(backend))
        measured.append(backend.read(line))
        Line.now += 1.0 / backend.rate
