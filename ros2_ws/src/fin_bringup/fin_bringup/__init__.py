"""Which nodes make a study, how they are started together, and how fast the whole graph is.

* `plants`: which nodes make which plant; `study_nodes`: which make a study; `study_arguments`: what shapes it;
* `bringup`: starts a study as processes, without the launch system; `processes`: which are started and ended together;
* `page/`: a study on a phone at the tank; `live`: the graph for viewers, with their `layouts/`; `live_gate`: who may;
* `benchmarks/`: how fast the whole graph is.
"""
