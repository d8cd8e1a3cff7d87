"""A laboratory's own fish, learnt from swims that it recorded, and how well it predicts other swims.

swims        a recorded swim, from CSV files; what is refused about it
recorded     the same from the bags of trials
settings     which parameters are fitted, within which bounds and with which prior: a YAML file
model        a fish with its drive: parameters by name, the chain and the beat that follow from them
prediction   the start found from a swim's first moments, the rest of the swim predicted
errors       what a prediction is judged by
left_out     how far a fitted fish is right about swims that were left out
fit          robust least squares over whole swims, many starts, errors from swim to swim
fish_file    the fitted fish as a file that simulator and optimiser take
cloud_prior  what it leaves open, for a cloud of plausible fish
page         measured against predicted, swim by swim
"""
