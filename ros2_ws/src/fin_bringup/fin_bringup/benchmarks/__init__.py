"""How fast the whole graph is, and its parts.

command          `bench`: measures all but the last, and prints tables or JSON
measuring        how much is measured, and how a time is taken
swims            many fish side by side: forms, precision, steps; over swims, links and cores
other_programs   the same swim by the general kernel, SciPy and MuJoCo
mujoco_fish      the paper's fish in MuJoCo
profile          where a batch's time goes, against the machine's limit
trials           trials of the whole graph: how fast a study goes
watched          what it costs to watch a study by `page` or `live`
lateness         `lateness`: how late the servo driver's ticks are while a study runs beside it
"""
