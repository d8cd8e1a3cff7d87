"""What a swim achieved: from its samples, whether they come from a running trial or from a bag.

mean_speed  the mean forward speed over a window of time, or why there is none
joints      serialised joint states as columns of numbers
recorded    a swim as its bag holds it, and what it achieved
swim        a swim's start and its window: the score of a whole swim, and all that it is asked for
measured    the other measures of a swim, by name
"""
