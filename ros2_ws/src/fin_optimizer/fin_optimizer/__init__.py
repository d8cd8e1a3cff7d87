"""The search for a better fin.

Proposes a fin, has a plant swim it, scores the swim from its velocity topic, records every trial to a bag and a
journal, and goes on. It works with any plant that keeps the contract of fin_plant.
"""
