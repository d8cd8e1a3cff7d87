"""Which fin to try next: pure functions of the seed and of what was tried before.

space         what is searched, and what every search offers: `Search`
distributions the same for Optuna
space_file    a space as a YAML file: `names` that may be searched, `stock`, `ties`, `conditions`
many          many candidates at once, as columns of the batch simulator
rules         what a plant is sent for a candidate of such a file, and why one cannot be
hill_climber  the paper's, and with two objectives one over the Pareto front
genetic       the paper's genetic algorithm
cma_es        CMA-ES
gp            Bayesian optimisation by a Gaussian process
tpe           Optuna's tree-structured Parzen estimator
nsga2         NSGA-II
random_search, quasi_random  candidates that no score decides
algorithms    all of them by name, and what each can do
cloud_search  a cloud of plausible fish (`plausible`), weighed by the scores (`cloud`), chooses what tells most
kept_speeds   what a cloud swam, kept for the next study of the same fins
told          what such a search says of its best, and how it works in slices
features, gaussian_process   the model of gp
pareto        fronts of candidates by several objectives
one_by_one    asks a search by generations for one candidate at a time
"""
