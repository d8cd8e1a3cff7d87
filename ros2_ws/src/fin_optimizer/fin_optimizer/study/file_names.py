"""What the files of a study's folder are called; nothing is imported here, so whoever needs a name pays for nothing."""

SETTINGS_FILE = "study.json"
JOURNAL_FILE = "journal.log"
BAG_FOLDER = "bags"
REPEATED_MARK = "repeated.txt"
"""In the bag of a trial that somebody wanted swum again."""
FIGURE_FILE = "speed_over_modulus.png"
FRONT_FILE = "pareto_front.png"
PARALLEL_FILE = "parallel_coordinates.png"
SLICES_FILE = "slices.png"
IMPORTANCE_FILE = "importance.png"
PICTURES = (FIGURE_FILE, FRONT_FILE, SLICES_FILE, PARALLEL_FILE, IMPORTANCE_FILE)
"""All that a study may have; the first of them is drawn of each."""


def of_goal(name: str, goal: str) -> str:
    """Return what a picture of another goal than the first is called: ``slices_power.png`` for ``slices.png``."""
    stem, _, suffix = name.rpartition(".")
    return f"{stem}_{goal}.{suffix}"
