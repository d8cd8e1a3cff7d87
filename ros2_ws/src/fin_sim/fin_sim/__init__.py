"""The simulated fish: physics of a body with a flexible caudal fin, and the plant node that swims it.

The public face for other packages: `fin_sim.swim` for one swim and the papers' fish, `fin_sim.batch` for many swims at
once. Nothing is imported here: the node starts without the batch's kernels.
"""
