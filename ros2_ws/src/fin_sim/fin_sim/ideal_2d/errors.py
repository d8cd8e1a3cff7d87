"""What can go wrong in a plane ideal flow."""

from __future__ import annotations

from fin_plant.validity import FoldedError


class MassError(ArithmeticError):
    """The mass matrix is not positive."""


class StrokeError(ArithmeticError):
    """A motion that cannot be swum: members collide, or it does not converge."""


class CollisionError(FoldedError):
    """Links of the fish's tail touch each other or the body.

    Attributes:
        members: Which, the body from 0; None where they come too close for the water between them.
        time: When, s since the start of what was advanced.
    """

    def __init__(self, members: tuple[int, int] | None, time: float) -> None:
        super().__init__()
        self.members, self.time = members, time

    def __str__(self) -> str:
        names = ["the body" if index == 0 else f"link {index}" for index in self.members or ()]
        what = f"{' and '.join(names)} collide" if names else "links come too close to each other or the body"
        return f"{what} at t = {self.time:.3g} s: take a stiffer fin, a slower or smaller beat"
