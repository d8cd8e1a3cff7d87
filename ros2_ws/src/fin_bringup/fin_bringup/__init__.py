"""Which nodes make a study, how they are started together, and how fast the whole graph is."""
