"""Drives of one joint, as Hypothesis draws them."""

from __future__ import annotations

from hypothesis import strategies as st

from fin_plant.gait import JointDrive

drives = st.builds(
    JointDrive,
    amplitude=st.floats(0.0, 1.0),
    frequency=st.floats(0.0, 5.0),
    phase=st.floats(-3.0, 3.0),
    bias=st.floats(-0.5, 0.5),
)
