"""A recorded trial is published again.

node      publishes it at a pace, with the services ~/pause and ~/resume
choice    what of a bag is played, and what is left out and why
playback  when which message is played
display   what a terminal shows of it
"""
