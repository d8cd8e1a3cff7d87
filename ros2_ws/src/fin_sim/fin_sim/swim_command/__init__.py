"""The command ``swim``: from its options to what it puts out.

* `command`: which of these swims: a case file, a swimmer of one's own, one fish, or many that differ in some number;
* `options`: the options and their help; `parameter_values`: numbers as words and parameter files give them;
  `plan_of_options`: what they ask for together;
* `plan`: what one swim needs; `axes`: what varies from swim to swim; `figures`: what can be told of a swim;
* `variation`: many swims on all cores; `quick_variation`: as many side by side, with fewer figures;
* `swimmer`: what a swimmer of one's own does in a plane ideal flow;
* `output`: tables, CSV, JSON and pictures.
"""
