"""The service of the emergency stop, on a node and in a thread of its own: it answers whatever the driver waits for."""

from __future__ import annotations

import contextlib
import threading
from typing import TYPE_CHECKING

from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import SetBool

from fin_plant import topics

if TYPE_CHECKING:
    from collections.abc import Callable

    from fin_servo_driver.robot_states import Answer


class EmergencyStop:
    """Serves a driver's ``~/estop`` from its making to `close`."""

    def __init__(self, driver: Node, act: Callable[[bool], Answer]) -> None:
        """Offer the service.

        Args:
            driver: The node in whose name the service is offered.
            act: Stops (True) or releases (False), and returns what to answer; called in another thread than all else.
        """
        self._act = act
        self._node = Node(
            f"{driver.get_name()}_{topics.EMERGENCY_STOP_SERVICE}",
            namespace=driver.get_namespace(),
            use_global_arguments=False,  # a name given to the driver is not this node's
            start_parameter_services=False,
            enable_rosout=False,
        )
        service = f"{driver.get_fully_qualified_name()}/{topics.EMERGENCY_STOP_SERVICE}"
        self._node.create_service(SetBool, service, self._on_request)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._serve, name="emergency stop", daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            self._executor.spin()

    def _on_request(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        try:
            answer = self._act(request.data)
        except Exception as error:  # noqa: BLE001 - it would end the thread, and the next stop would not be served
            response.success, response.message = False, f"not done, use the switch of the servos: {error!r}"
            return response
        response.success, response.message = answer.accepted, answer.text
        return response

    def close(self) -> None:
        """Serve it no more."""
        self._executor.shutdown()
        self._thread.join()
        self._node.destroy_node()
