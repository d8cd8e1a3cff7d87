"""Stamps: times of a plant as whole nanoseconds, as ROS 2 writes them in headers."""

NANOSECONDS = 1_000_000_000
"""In a second."""
