"""The machine that turns the blocks, one tick at a time."""
