"""A study: what was tried, what came of it, and what people are shown of it.

settings         what decides candidates and scores, written once
study            the ledger: an Optuna study in a journal on the disk
journal          the journal's lines, whole or not at all
checked_journal  the same with check sums, as Optuna reads it
report           table and figures
picture          which figures a study gets
simulated_curve  the simulator's speed behind the trials
resume_check     whether the scores of a study still follow from its bags
provenance       which versions swam
"""
