"""The paper's experiments, and any search over a space, carried out in the batch simulator.

experiments     the paper's, what is run
space_campaign  any search over the space of a file, what is run
campaign        the command that runs both, resumed where they were cut short
executors       where they run: processes of this machine, or a cluster
comparison      every number that the papers state, with ours beside it
figures         the paper's figures
space_report    what a campaign over a space leaves: tables, the best in words, pictures
"""
