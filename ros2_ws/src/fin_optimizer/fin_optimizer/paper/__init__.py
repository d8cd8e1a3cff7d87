"""The paper's experiments, carried out in the batch simulator.

experiments  what is run
campaign     the command that runs them, resumed where they were cut short
executors    where they run: processes of this machine, or a cluster
comparison   every number that the papers state, with ours beside it
figures      the paper's figures
"""
