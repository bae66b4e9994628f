"""A campaign: many traversals drawn from stated distributions, flown on many processes, and counted honestly.

``spec`` says what is drawn, ``sampling`` where in the unit cube run k lies, ``pool`` and ``cluster`` fly, ``journal`` keeps
what is done, ``summary`` counts. What a run *is* comes from outside as a function: campaigns know no simulator.
"""
