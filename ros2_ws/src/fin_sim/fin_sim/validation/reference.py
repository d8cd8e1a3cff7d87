"""The cases of an independent solver: dense virtual-power form, adaptive integration of order 8."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import numpy as np

from fin_sim import case as case_files
from fin_sim.validation.page import Check, Section

if TYPE_CHECKING:
    from pathlib import Path


def compare(path: Path) -> dict[str, float]:
    """Return the deviations from a case file's summary and from the trajectory beside it.

    Relative for ``mean_speed``, ``mean_thrust_last_two_periods`` and ``mean_power_last_two_periods``; rad for
    ``final_psi``; ``position`` over the distance swum (of a held body in m); ``angle`` in rad, largest of all joints;
    ``force`` and ``power`` over their largest value.
    """
    case = case_files.read_case(path)
    swim = case.swim()
    every = case_files.SAMPLES_A_ROW
    got, wanted = case_files.summary(swim, every=every), json.loads(path.read_text(encoding="utf-8"))["summary"]
    result = {}
    for name, value in wanted.items():
        # A power of 1e-20 W is nought: relative to what a plate under tow takes.
        scale = 1.0 if name == "final_psi" else max(abs(value), 1e-6)
        result[name] = abs(got[name] - value) / scale
    rows = np.genfromtxt(path.with_suffix(".csv"), delimiter=",", names=True)
    if len(rows) != len(swim.time[::every]):
        msg = f"{path.with_suffix('.csv')} has {len(rows)} rows, {len(swim.time[::every])} are needed"
        raise ValueError(msg)
    distance = float(np.hypot(rows["x"][-1], rows["y"][-1])) or 1.0
    offset = np.hypot(swim.x[::every] - rows["x"], swim.y[::every] - rows["y"])
    result["position"] = float(offset.max()) / distance
    angles = np.stack([rows[f"theta{index}"] for index in range(len(case.chain.links))], axis=1)
    result["angle"] = float(np.abs(swim.joint_angles[::every] - angles).max())
    for name, values, column in (
        ("power", swim.servo_power, "power"),
        ("force x", swim.convective_force[:, 0], "tip_force_x"),
        ("force y", swim.convective_force[:, 1], "tip_force_y"),
    ):
        scale = max(float(np.abs(rows[column]).max()), 1e-12)
        result[name] = float(np.abs(values[::every] - rows[column]).max()) / scale
    return result


TARGETS = {
    "mean_speed": 1e-3,
    "final_psi": 5e-3,
    "mean_thrust_last_two_periods": 1e-3,
    "mean_power_last_two_periods": 1e-3,
    "position": 5e-3,
    "angle": 1e-3,
    "power": 1e-3,
    "force x": 1e-3,
    "force y": 1e-3,
}
"""Largest deviations that pass; speed, thrust, power and position are the project's goal, the others as tight."""


def section(folder: Path) -> Section:
    """Return the part on the reference cases in ``folder``."""
    checks = [
        Check(f"{path.stem}: {name.replace('_', ' ')}", deviation, TARGETS[name])
        for path in sorted(folder.glob("*.json"))
        for name, deviation in compare(path).items()
    ]
    text = """
Trajectories of a second solver that shares no line with this one (`tests/data/cases`). The means over the last two
periods follow the reference: trapezoids over those rows of the file that lie in the last two periods, which for
`anchored_massless_fin` are 1.99 periods; over two whole periods its thrust is 0.4 % higher in both solvers."""
    return Section("An independent solver", checks, text)
