"""An emulated device on a pseudo-terminal, which can be unplugged, fall silent, lose bytes or be slow."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections import deque
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pathlib import Path

    from fin_servo_driver.emulator.devices import Device

_LOOK, _PACED_LOOK = 0.002, 0.0002
_BITS_A_BYTE = 10
"""With a start bit and a stop bit."""
_BOOT = 0.05
"""s from the opening of the port to the device's first word; a real board takes longer, and who opens flushes first."""


class _Way:
    """One direction of the line: bytes arrive when the last of them is through."""

    def __init__(self, baud: int, delay: float) -> None:
        self._seconds_a_byte = _BITS_A_BYTE / baud if baud else 0.0
        self._delay = delay
        self._under_way: deque[tuple[float, bytes]] = deque()
        self._free_at = 0.0

    def put(self, data: bytes, now: float) -> None:
        """Send bytes."""
        self._free_at = max(self._free_at, now + self._delay) + len(data) * self._seconds_a_byte
        self._under_way.append((self._free_at, data))

    def take(self, now: float) -> bytes:
        """Return what has arrived."""
        arrived = b""
        while self._under_way and self._under_way[0][0] <= now:
            arrived += self._under_way.popleft()[1]
        return arrived


class PtyPort:
    """A serial port with a device on its other end. ``path`` is a link, which stays the same over a replug.

    Attributes:
        path: What the driver opens.
        device: The device.
        drop_rate: Part of the bytes that are lost on the way, each way.
        silent: Whether the device hears nothing and says nothing.
        echoes: Whether the adapter hears itself, as on two wires where the receiver stays on.
        received: All bytes that came from the driver since the last replug, if `keep` was asked for.
    """

    def __init__(
        self, device: Device, path: Path, *, seed: int = 0, keep: bool = False, baud: int = 0, delay: float = 0.0
    ) -> None:
        """Plug the device in and start to serve it.

        Args:
            device: The device.
            path: Where its port is to be.
            seed: Of the bytes that are lost.
            keep: Whether to keep what is received.
            baud: Bits a second of the line; 0 carries everything at once.
            delay: s that every answer takes longer: what the device and a USB adapter wait.

        Raises:
            FileExistsError: Something else than an earlier port's link is at ``path``.
        """
        if path.exists() and not path.is_symlink():
            msg = f"{path} is no link: the emulated port does not take its place"
            raise FileExistsError(msg)
        self.device = device
        self.path = path
        self.drop_rate = 0.0
        self.silent = False
        self.echoes = False
        self.received = bytearray()
        self._keep = keep
        self._baud = baud
        self._delay = delay
        self._random = np.random.default_rng(seed)
        self._master: int | None = None
        self._is_open = False
        self._speaks_at = float("inf")
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self.plug()
        self._thread = threading.Thread(target=self._serve, name="pty", daemon=True)
        self._thread.start()

    @property
    def plugged(self) -> bool:
        """Whether the port is there."""
        return self._master is not None

    def plug(self) -> None:
        """Make the port appear."""
        with self._lock:
            if self._master is not None:
                return
            master, slave = os.openpty()
            tty.setraw(slave)
            name = os.ttyname(slave)
            os.close(slave)
            os.set_blocking(master, False)
            link = self.path.with_name(self.path.name + ".new")
            link.unlink(missing_ok=True)
            link.symlink_to(name)
            link.rename(self.path)
            self.received = bytearray()
            self._to_device, self._to_driver = _Way(self._baud, 0.0), _Way(self._baud, self._delay)
            self._is_open = False
            self._master = master

    def unplug(self, *, powered: bool = False) -> None:
        """Make the port disappear under whoever has it open; the device loses its power, unless it has its own."""
        with self._lock:
            if self._master is None:
                return
            self.path.unlink(missing_ok=True)
            os.close(self._master)
            self._master = None
            if not powered:
                self.device.lose_power()

    def close(self) -> None:
        """Unplug and stop serving."""
        self._ended.set()
        self._thread.join()
        self.unplug()

    def _serve(self) -> None:
        while not self._ended.is_set():
            with self._lock:
                if self._master is not None:
                    self._serve_once(self._master, time.monotonic())
                self.device.tick(time.monotonic())
            self._ended.wait(_PACED_LOOK if self._baud or self._delay else _LOOK)

    def _serve_once(self, master: int, now: float) -> None:
        """Notice that somebody opens the port, and serve what waits."""
        poller = select.poll()
        poller.register(master, select.POLLIN)
        events = dict(poller.poll(0)).get(master, 0)
        is_open = not events & select.POLLHUP
        if is_open and not self._is_open:
            self._speaks_at = now + _BOOT
        if now >= self._speaks_at and not self.silent:
            self._speaks_at = float("inf")
            self._to_driver.put(self.device.opened(now), now)
        self._is_open = is_open
        if events & select.POLLIN:
            try:
                data = os.read(master, 4096)
            except OSError:  # the other end has just closed
                return
            if self._keep:
                self.received += data
            if self.echoes:
                self._to_driver.put(data, now)
            if not self.silent:
                self._to_device.put(self._lossy(data), now)
        if arrived := self._to_device.take(now):
            self._to_driver.put(self.device.feed(arrived, now), now)
        self._answer(master, self._to_driver.take(now))

    def _answer(self, master: int, data: bytes) -> None:
        if data:
            try:
                os.write(master, self._lossy(data))
            except OSError:  # nobody reads: a full buffer, or the other end has closed
                return

    def _lossy(self, data: bytes) -> bytes:
        if self.drop_rate <= 0.0:
            return data
        kept = self._random.random(len(data)) >= self.drop_rate
        return bytes(byte for byte, keep in zip(data, kept, strict=True) if keep)
