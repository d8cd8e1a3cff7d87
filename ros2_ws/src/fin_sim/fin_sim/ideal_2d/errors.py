"""What can go wrong in a plane ideal flow."""

from __future__ import annotations


class MassError(ArithmeticError):
    """The mass matrix is not positive."""


class StrokeError(ArithmeticError):
    """A motion that cannot be swum: members collide, or it does not converge."""
