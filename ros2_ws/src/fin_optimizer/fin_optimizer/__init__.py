"""The search for a better fin.

Proposes a fin, has a plant swim it, scores the swim from its velocity topic, records every trial to a bag and a
journal, and goes on. It works with any plant that keeps the contract of fin_plant.

* `optimizer`: the node; `mode`: what it is about; `thinking`: what a search does between two trials;
* `parameters`, `gait_parameters`: its parameters; `plan`: what they ask for;
* `goals`: what can be good in a swim; `checksums`: whether what was written is what is read;
* `announcer`: tells topics which fin swims; `progress`: tells a terminal; `words`: how values are shown;
* `search/`: which fin next; `trial/`: one trial; `score/`: what a swim achieved; `study/`: what was tried;
* `bags/`: what was recorded; `player/`: it is published again; `calibration/`: a fish learnt from it;
* `report/`, `cutting/`: a page, and a drawing to cut; `paper/`: the paper's experiments; `commands/`: what people type.
"""
