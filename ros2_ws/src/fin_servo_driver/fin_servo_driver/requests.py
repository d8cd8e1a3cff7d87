"""Questions to services of which nobody waits for the answer: each is sent at once, or when its service is found."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.srv import ChangeState

if TYPE_CHECKING:
    from collections.abc import Callable


@dataclass
class Request:
    """A question to a service.

    Attributes:
        name: What it asks for.
        client: Of the service.
        message: The service's request.
        deadline: s of the monotonic clock, after which nobody waits for the answer.
        without_answer: What is said then.
        still_asked: Whether what it answers is still asked; it is not sent any more once that is false.
        future: Of the answer, None until the service was found.
        sent: s of the monotonic clock at which it was sent.
    """

    name: str
    client: Any
    message: Any
    deadline: float
    without_answer: str
    still_asked: Callable[[], bool] = lambda: True
    future: Any = None
    sent: float = 0.0


@dataclass(frozen=True)
class Answer:
    """What came of a request.

    Attributes:
        name: What was asked for.
        service: Full name of the service.
        accepted: Whether it was done; False too where no answer came.
        text: What was answered, as a person reads it.
        seconds: From sending it until the answer; None where none came.
    """

    name: str
    service: str
    accepted: bool
    text: str
    seconds: float | None


class Requests:
    """What was asked and is not answered yet. For one thread, that of the executor."""

    def __init__(self, answered: Callable[[Answer], object]) -> None:
        """Start with nothing asked.

        Args:
            answered: Called with each answer, and where none comes.
        """
        self._answered = answered
        self._open: list[Request] = []

    @property
    def names(self) -> list[str]:
        """What was asked for, the oldest first."""
        return [request.name for request in self._open]

    def send(self, request: Request) -> None:
        """Send it now, or when its service is found."""
        self._open.append(request)
        self.see_to()

    def drop_unsent(self) -> None:
        """Forget what waits for its service."""
        self._open = [request for request in self._open if request.future is not None]

    def see_to(self) -> None:
        """Send what can be sent, and take the answers."""
        answers, waiting = [], []
        for request in self._open:
            if answer := self._see_to(request):
                answers.append(answer)
            else:
                waiting.append(request)
        self._open = waiting
        for answer in answers:
            self._answered(answer)

    def _see_to(self, request: Request) -> Answer | None:
        service = str(request.client.service_name)
        if request.future is None and not request.still_asked():
            said = f"{request.name}: the driver waits for something else now, look again"
            return Answer(request.name, service, accepted=False, text=said, seconds=None)
        if request.future is None and request.client.service_is_ready():
            request.sent = time.monotonic()
            request.future = request.client.call_async(request.message)
            request.future.add_done_callback(lambda _: self.see_to())
        if request.future is not None and request.future.done():
            response = request.future.result()
            took = time.monotonic() - request.sent
            return Answer(request.name, service, bool(response.success), _text(request.name, response), took)
        if time.monotonic() > request.deadline:
            return Answer(request.name, service, accepted=False, text=request.without_answer, seconds=None)
        return None


def _text(name: str, response: Any) -> str:
    """Return an answer as a person reads it; why a transition was refused is in the state's reason."""
    if isinstance(response, ChangeState.Response):
        return f"{name}: {'done' if response.success else 'refused'}"
    return str(response.message)
