"""Proof of the model: closed forms, an independent solver, orders of convergence, published curves, measured swims."""
