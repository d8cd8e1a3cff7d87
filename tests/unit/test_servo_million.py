"""A million random and mutated inputs: no exception gets out, no set-point gets beyond the limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from fin_plant.messages import gait_from_message
from fin_servo_driver import backends, robot_file
from fin_servo_driver.backends import firmata, modbus
from fin_servo_driver.emulator import packets
from fin_servo_driver.line import DeviceError
from fin_servo_driver.relay import RelayMotion
from fin_servo_driver.robot_file import RelayJoint, RelayTiming, ServoJoint
from fin_servo_driver.safety import SetPointLimiter
from fin_servo_driver.set_points import Motion, ServoMotion
from fin_servo_driver.tail import Command, Settings, Tail
from support.random_gaits import numbers, random_gaits
from support.wire import OwnClock

if TYPE_CHECKING:
    from fin_plant.gait import Gait

pytestmark = pytest.mark.long
JOINT = ServoJoint(9, 1500, -1, 573, 1200, 1800, 0.27, 6.0)


@pytest.mark.timeout(900)
def test_half_a_million_angles_and_times_stay_inside_the_limits() -> None:
    random = np.random.default_rng(11)
    limiter, last = SetPointLimiter(JOINT, 0.04), 0.0
    with np.errstate(all="ignore"):
        times = np.abs(numbers(random, 500_000)) * 0.02
    for angle, elapsed in zip(numbers(random, 500_000), times, strict=True):
        result = limiter.limit(float(angle), float(elapsed))
        assert 1200.0 <= result.position <= 1800.0
        assert abs(result.angle) <= 0.27
        assert abs(result.angle - last) <= 6.0 * 0.04 + 1e-12
        last = result.angle


@pytest.mark.timeout(900)
@pytest.mark.parametrize("kind", ["servos", "relays"])
def test_a_hundred_thousand_messages_move_a_tail_inside_its_limits_or_are_refused(kind: str) -> None:
    random = np.random.default_rng(12)
    motion: Motion = ServoMotion([JOINT], 0.02)
    if kind == "relays":
        motion = RelayMotion([RelayJoint(9, 10)], RelayTiming(), 0.01)
    tail = Tail(motion, Settings(0.5, 0.2))
    tail.arm(0.0)
    now, refused, followed = 0.0, 0, 0
    for message in random_gaits(random, 100_000):
        now += float(random.exponential(0.05))
        try:
            gait: Gait = motion.allowed(gait_from_message(message), 0.2618, 5.0)
        except ValueError:
            refused += 1
        else:
            followed += tail.command(Command(gait, now), {})
        outputs = tail.tick(now)
        if outputs and kind == "relays":
            assert outputs[9] + outputs[10] <= 1.0
        elif outputs:
            assert 1200.0 <= outputs[9] <= 1800.0
    assert min(refused, followed) > 10_000


class GarbageLine:
    """A line on which anything may come, and writes always work."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._valid = [b"\xf9\x02\x05", b"\x00\x00", packets.encode(1, packets.STATUS, b"\x00\x00\x08\x00\x00")]

    def write(self, data: bytes) -> None:
        self._valid[1] = data[:8]

    def read(self, timeout: float) -> bytes:
        del timeout
        chunk = bytearray(self._valid[int(self._random.integers(0, 3))] * int(self._random.integers(0, 3)))
        for _ in range(int(self._random.integers(0, 4))):
            place = int(self._random.integers(0, len(chunk) + 1))
            chunk[place:place] = self._random.bytes(int(self._random.integers(1, 4)))
        if chunk and self._random.random() < 0.5:
            chunk[int(self._random.integers(0, len(chunk)))] ^= 1 << int(self._random.integers(0, 8))
        return bytes(chunk)


class AheadClock(OwnClock):
    """One that runs ahead each time that somebody looks at it."""

    def monotonic(self) -> float:
        self.now += 0.004
        return self.now


@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", sorted(backends.BACKENDS))
def test_garbage_on_the_line_raises_nothing_but_device_errors(name: str) -> None:
    """Each back end lives through garbage; the SDK's own waits are cut short by a clock that runs ahead."""
    backend = backends.make(robot_file.load(robot_file.find(name)), AheadClock())
    line, failed = GarbageLine(13), 0
    channels = [channel for joint in backend.robot.joints for channel in joint.channels]
    outputs = dict.fromkeys(channels, (backend.lowest + backend.highest) / 2.0)
    for number in range(3_000):
        steps = (
            lambda: backend.identify(line),
            lambda: backend.enable(line, dict(outputs)),
            lambda: backend.send(line, dict(outputs)),
            lambda: backend.read(line),
            lambda: backend.disable(line),
        )
        try:
            steps[number % len(steps)]()
        except DeviceError:
            failed += 1
    assert failed < 3_000


@pytest.mark.timeout(900)
def test_three_hundred_thousand_chunks_of_garbage_break_no_parser() -> None:
    random = np.random.default_rng(14)
    banner, status = firmata.Parser(), packets.Parser()
    for _ in range(300_000):
        chunk = random.bytes(int(random.integers(0, 12)))
        if random.random() < 0.2:
            chunk = b"\xff\xff\xfd\x00\x01" + chunk
        banner.feed(chunk)
        status.feed(chunk)
        modbus.answer_in(chunk, modbus.read_coils(1, 0, 8))
        assert len(banner._message) <= 256
