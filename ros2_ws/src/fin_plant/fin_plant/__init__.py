"""The contract of every fish plant, simulated or real.

What an optimiser, a viewer or an operator can rely on whichever plant swims: the fin and the gait as validated values,
the parameters with their units and ranges, the topics with their types and qualities of service. The simulator and the
servo driver implement it, the optimiser speaks it.
"""
