"""StairBench: gymnasium environments on the simulator, and scores of policies (``pip install 'treadline[bench]'``).

``import treadline.bench`` registers ``treadline/StairUp-v0`` and so on; ``treadline bench POLICY`` prints the scores.
"""

from gymnasium import register

from treadline.bench.environment import StairEnv, make_vec
from treadline.bench.policies import Spaces
from treadline.bench.tasks import TASKS

__all__ = ["TASKS", "Spaces", "StairEnv", "make_vec"]

for task in TASKS:
    register(id=f"treadline/{task}-v0", entry_point="treadline.bench.environment:StairEnv", kwargs={"task": task})
