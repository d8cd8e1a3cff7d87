"""The real fish.

Turns a gait into set-points for the tail servos, keeps them inside angle, rate and pulse limits, and falls back to
neutral and disabled whenever it is in doubt.
"""
