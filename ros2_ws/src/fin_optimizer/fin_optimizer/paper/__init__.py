"""The paper's experiments, carried out in the batch simulator.

experiments  what is run
campaign     the command that runs them, resumed where they were cut short
figures      the paper's figures and numbers drawn from them
"""
