"""The simulated fish.

A free body with a driven, jointed tail and a caudal fin of elastic hinges swims in still water. What a user describes
(fin, fish, gait) becomes a chain of links, a compiled kernel integrates it, and a node offers the swim as topics, services
and parameters.
"""
