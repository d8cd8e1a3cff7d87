"""Bags of trials: rosbag2 bags in MCAP that survive a kill, without ROS.

messages        serialised messages: their types, stamps and velocities
log_time        the time at which a message is logged
writer          writes a bag, each second on the disk
metadata        what describes a bag as a whole
model_messages  what a 3-D view needs, computed from what was recorded
enrich          the same for bags that were recorded without it, in a copy
reader          reads any bag, also one of other writers
contents        what one file of it holds, and how far it is whole
quality         what the publishers of a recorded topic offered
own             which bags the optimiser recorded itself, and whether they were closed
mcap_records    the records of an MCAP file, up to where it was cut off
files           where a bag's files are
integrity       what check sums tell
repair          closes bags that were left open
disk_space      whether there is room for one more
"""
