"""The contract of every fish plant, simulated or real, and what all packages share.

What an optimiser, a viewer or an operator can rely on whichever plant swims. The simulator and the servo driver
implement it, the optimiser speaks it.

The contract:

* `topics`, `services`: names, types and quality of service; `messages`, `stamps`: what is in a message;
* `fin`, `gait`: the fin and the gait as validated values; `gait_follower`: how a tail goes from one gait to the next;
* `plant_state`: what a plant is doing; `validity`: where a swim's model holds;
* `parameters`: tables of parameters, with units and ranges; `units`: quantities as people write them;
* `fish_model`, `frames`: what a fish looks like and where its links are; `model_topics`: both for viewers.

How a node runs:

* `node_process`: how it starts and ends; `node_parameters`: its parameters; `node_help`: what it shows for ``--help``;
* `ros_arguments`, `ros_environment`: what ROS 2 would read in another way than people, looked at before it does;
* `discovery`: what a node sees of the graph, and why nothing comes on a topic.

How a command runs:

* `start`: its first moment; `command`: its error line and exit codes; `output`: what it does when its reader has gone;
* `executables`, `sub_commands`: which there are; `figures`: how every picture is drawn.

How files and words are read and written:

* `checks`: what every refusal says; `paths`: paths as a person gives them;
* `text_file`, `yaml_file`, `json_file`: one reader for each kind; `whole_file`: a file is written whole or not at all;
* `private_folder`: a folder of this user alone, for what can be made again.
"""
