"""A study: what was tried, what came of it, and what people are shown of it.

settings         what decides candidates and scores, and the text of `study.json`
file_names       what the files of its folder are called
folder           begins and locks a study's folder, whole or not at all
journal          the journal's lines, whole or not at all
checked_journal  the same with check sums, as Optuna reads it
candidate        a candidate, its trials, and what follows from them
records          the trials that a journal tells of, checked
ledger           `Study`: proposes, notes and resumes; an Optuna study in the journal
recovery         the journal made anew, from its whole entries and the bags
report           table of all trials
final_report     what a study leaves, and the sentences that say what was found
pictures         which pictures a study gets
drawing          how they are drawn
space_drawing    the same for a space of several parameters
importance       which parameter decides
simulated_curve  the simulator's speed behind the trials
resume_check     whether the scores of a study still follow from its bags
provenance       which versions swam
"""
