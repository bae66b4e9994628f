"""The functions of ``import treadline as tl``: arrays, paths and names in, results that print as tables out."""
