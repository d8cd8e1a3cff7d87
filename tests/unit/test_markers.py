"""The fish as markers: one for the body and each link, gone when the link is."""

from __future__ import annotations

from builtin_interfaces.msg import Time

from fin_plant.fin import Fin
from fin_sim.chain import build_chain
from fin_sim.dynamics import Stepper
from fin_sim.markers import fish_markers
from fin_sim.swim import PAPER_FISH, SIMULATOR_PARAMETERS


def test_marker_of_a_link_that_is_gone_vanishes_within_a_second() -> None:
    chain = build_chain(PAPER_FISH, Fin(segments=5, hinges="midpoint"))
    state = Stepper(chain, 1e-3).start()
    markers = fish_markers(chain, SIMULATOR_PARAMETERS.checked({}), state, Time(sec=3)).markers
    assert len(markers) == 7
    assert all((marker.lifetime.sec, marker.lifetime.nanosec) == (1, 0) for marker in markers)
