"""The ideal flow in three dimensions around a thin tail and an ellipsoid's body (``water.model = surface_3d``).

* `sheet`: the tail as a lattice of vortex rings. `ellipsoid`: Lamb's flow, and sources on the body.
* `added_mass`: the matrix of body and links in the straight pose, and the factors of the links' virtual moments.
* `factors`: the same factors from a table, or solved once.

Unknowns are on the sheet and the body only, as in a surface integral equation; no water is divided into cells.
"""
