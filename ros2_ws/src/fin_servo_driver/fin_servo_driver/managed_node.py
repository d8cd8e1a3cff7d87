"""The life cycle of a managed node: each transition is a driver's work, and a refusal keeps the state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from fin_servo_driver.line import DeviceError

if TYPE_CHECKING:
    from collections.abc import Callable

    from lifecycle_msgs.srv import ChangeState

RCLError = rclpy_implementation.RCLError


class Driver(Protocol):
    """What a driver does at each transition.

    A ValueError or a DeviceError refuses it, anything else leads to `recover`.
    """

    def configure(self) -> None:
        """Open and check the port."""

    def arm(self) -> None:
        """Allow motion."""

    def disarm(self) -> None:
        """Lead the tail to neutral, and allow no motion any more."""

    def release(self) -> None:
        """Make the device safe and close the port."""

    def recover(self) -> None:
        """Make the device safe and close the port after something unforeseen."""

    def refused(self, what: str, reason: str) -> None:
        """Note why a transition was refused."""

    def publish_state(self) -> None:
        """Tell the state after a transition."""


class ManagedNode(LifecycleNode):
    """A node whose transitions a driver makes.

    Attributes:
        driver: Makes them.
    """

    driver: Driver

    def refuse_what_is_no_transition(self) -> None:
        """Refuse a transition that the node's state does not have: rclpy would end the node with an exception."""
        service = self._service_change_state
        change_state = service.callback

        def guarded(request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
            try:
                change_state(request, response)
            except RCLError as error:
                self.get_logger().error(f"transition refused: {error}")  # type: ignore[no-untyped-call]
                response.success = False
            return response

        service.callback = guarded

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open and check the port."""
        del state
        return self._result("configure", self.driver.configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Arm."""
        del state
        return self._result("activate", self.driver.arm)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go to neutral and disarm."""
        del state
        return self._result("deactivate", self.driver.disarm)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the port."""
        del state
        return self._result("clean up", self.driver.release)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go to neutral, disarm and close the port."""
        del state
        return self._result("shut down", self.driver.release)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Leave everything safe; the driver can then be configured anew."""
        del state
        return self._result("recover", self.driver.recover)

    def _result(self, what: str, work: Callable[[], None]) -> TransitionCallbackReturn:
        """Do the work; a refusal keeps the state, anything unforeseen leads to `on_error`."""
        try:
            work()
        except (ValueError, DeviceError) as error:
            self.driver.refused(what, str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # noqa: BLE001 - rclpy would swallow it without a word
            self.driver.refused(what, f"unforeseen: {error!r}")
            return TransitionCallbackReturn.ERROR
        self.driver.publish_state()
        return TransitionCallbackReturn.SUCCESS
