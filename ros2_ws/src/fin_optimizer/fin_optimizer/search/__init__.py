"""Which fin to try next: pure functions of the seed and of what was tried before.

space         what is searched, and what every search offers: `Search`
distributions the same for Optuna
hill_climber  the paper's, and with two objectives one over the Pareto front
genetic       the paper's genetic algorithm
cma_es        CMA-ES
one_by_one    asks a search by generations for one candidate at a time
"""
