"""Mission: planners up and down, plug-ins, and the loop that connects the blocks, one tick at a time.

Contract: ``mission_blocks.build_blocks(MissionConfig) -> Blocks``; ``loop.Mission`` ticks them; the nodes of ``ros`` wire the same
``blocks``.
"""
