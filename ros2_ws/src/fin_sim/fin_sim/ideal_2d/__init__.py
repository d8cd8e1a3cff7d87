"""Articulated bodies in a plane ideal flow: no viscosity, no wake, no circulation.

The water has no motion of its own: its kinetic energy is that of the bodies' motion, through their added mass.

* `outline`: sections and fins without thickness, as points that integrals are sums over;
* `linkage`: how they hang together, and where each is for given joint angles;
* `added_mass`: the boundary integrals: the mass matrix of bodies and water, and its derivatives;
* `stroke`: joints with prescribed angles, at zero momentum: the net motion of a stroke (geometric phase);
* `elastic`: joints with springs, and momentum;
* `table`: smooth functions of joint angles as Chebyshev sums;
* `plane_fish`: the simulator's fish in this water; `plane_dynamics`: the kernel that moves it, with a table;
  `direct_dynamics`: the same motion without one; `plane_stepper`: chooses, and advances the fish;
* `swimmer_file`, `swimmer_picture`: a swimmer of one's own, and its pictures;
* `errors`: what can go wrong.

Kanso, Marsden, Rowley & Melli-Huber, "Locomotion of articulated bodies in a perfect fluid", Journal of Nonlinear
Science 15 (2005); Kelly's BhT is of this kind.
"""
