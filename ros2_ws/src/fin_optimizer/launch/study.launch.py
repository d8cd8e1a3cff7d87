"""A study by the name of the package in which its launch file used to be: it is fin_bringup's."""

from __future__ import annotations

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """Return what includes the launch file."""
    path = PathJoinSubstitution([FindPackageShare("fin_bringup"), "launch", "study.launch.py"])
    return LaunchDescription([IncludeLaunchDescription(path)])
