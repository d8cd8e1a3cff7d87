"""One trial, from a proposed fin to its result.

result        how a trial ends
trial         the table of its phases, and the machine that goes through them; knows neither ROS nor a clock
facts         what the machine looks at, as the node sees it
swimmer       a fish and its trial under way: turns actions into messages, calls and files
plant_client  how a plant is spoken to
recorder      listens to the plant's topics and writes its bag
silence       what is said of a topic on which nothing comes
"""
