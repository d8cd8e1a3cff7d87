"""What an optimiser is about, as its `progress` says it; without ROS."""

from __future__ import annotations

from enum import Enum


class Mode(Enum):
    """What the optimiser is about."""

    HOLDING = "holding until ~/start is called"
    RUNNING = "running"
    PAUSING = "pausing after this trial"
    STOPPING = "stopping"
    DONE = "done"
