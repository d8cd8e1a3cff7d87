"""The thread that alone speaks to the device: a device loop on this machine's clock."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from typing import TYPE_CHECKING

from fin_servo_driver.device_loop import DeviceLoop
from fin_servo_driver.health import ENDED

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_servo_driver.backends.backend import Backend
    from fin_servo_driver.line import OpenLine
    from fin_servo_driver.set_points import Motion
    from fin_servo_driver.tail import Phase, Settings

_JOIN_SECONDS = 10.0
_LOOK = 0.002


class IoThread(DeviceLoop):
    """Owns the line from `start` to `close`."""

    def __init__(
        self,
        backend: Backend,
        motion: Motion,
        settings: Settings,
        open_line: Callable[[], OpenLine],
        port: str,
        report: Callable[[str], None],
    ) -> None:
        """Take what the loop works with; nothing is opened yet."""
        super().__init__(backend, motion, settings, open_line, port, report)
        self._wake: queue.SimpleQueue[None] = queue.SimpleQueue()  # unlike an Event safe in a signal's handler
        self._thread = threading.Thread(target=self._run, name="servo I/O", daemon=False)

    def start(self) -> None:
        """Open and identify the device, then start the thread.

        Raises:
            DeviceError: Port or device are not as configured, or a stop was asked for; nothing stays open.
        """
        self.connect()
        self._thread.start()

    def wait_for(self, phases: set[Phase], timeout: float) -> bool:
        """Wait until the tail is in one of the phases; False if it is not after ``timeout`` s."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline and self._thread.is_alive():
            if self.health.phase in phases and not self.is_asked:
                return True
            time.sleep(_LOOK)
        return self.health.phase in phases

    def close(self) -> None:
        """End the thread; it disables the device and closes the port."""
        self.end()
        if self._thread.ident is not None:
            self._thread.join(_JOIN_SECONDS)
        if self._line is not None:  # the thread was never started, or hangs
            self.finish("the driver has closed its port")

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def _run(self) -> None:
        reason = ENDED
        try:
            while (idle := self.turn()) is not None:
                self._sleep(idle)
        except Exception as error:
            reason = f"the driver's I/O thread has failed: {error!r}"
            self._report(reason)
            raise
        finally:
            self.finish(reason)

    def _wake_up(self) -> None:
        self._wake.put(None)

    def _sleep(self, seconds: float) -> None:
        """Wait until somebody asks for something, at most so long."""
        with contextlib.suppress(queue.Empty):
            self._wake.get(timeout=seconds)
            while True:  # one turn does all that was asked for
                self._wake.get_nowait()
