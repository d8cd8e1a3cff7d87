"""What a swim achieved: from its samples, whether they come from a running trial or from a bag.

mean_speed  the mean forward speed over a window of time, or why there is none
joints      serialised joint states as columns of numbers
recorded    a swim as its bag holds it, and what it achieved
swim        a swim's start, its window, its power: the score and the energy per metre of a whole swim
"""
