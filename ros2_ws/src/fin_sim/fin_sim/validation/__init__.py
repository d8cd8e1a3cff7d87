"""Proof of the model: closed forms, an independent solver, orders of convergence, published curves, measured swims.

* `command`: ``validation``, which writes docs/validation.md; `page`: checks with their targets, and that page;
* `equations`, `potential_flow`: against closed forms; `reference`: against an independent solver;
* `convergence`: orders of convergence in time step and segments;
* `paper`: the papers' curves of speed over stiffness; `waters`: speed in each kind of water;
* `measured_fins`, `later_fins`: printed fins, measured; `measured`: measured swims of a tail-actuated fish.
"""
