"""Mission: planners, guard, plug-ins and the in-process loop that connects the blocks, one tick at a time."""
