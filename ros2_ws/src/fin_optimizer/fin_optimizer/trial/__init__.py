"""One trial, from a proposed fin to its result.

swimmer       the loop: begins a trial, looks, carries out its actions, has its result
trial         the machine that goes through the phases at each look; knows neither ROS nor a clock
phases        the table of the phases, with its guards and rules
facts         the frozen snapshot that machine and guards look at
observer      takes that snapshot from the plant, the recorder and the graph
gait_check    whether a plant swims the gait that is asked for
plant_client  how a plant is spoken to
recorder      listens to the plant's topics and writes its bag
subscription  one of these topics: all that came, with the quality of service that is offered
silence       what is said of a topic on which nothing comes
scored        what a recorded swim makes of its trial
result        how a trial ends
"""
