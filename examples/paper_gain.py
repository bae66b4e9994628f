"""The paper's own matrices: does Eq. (14) follow, and what does it ask of the tracks at 30° of heading?"""

import numpy as np

from treadline.control import lqr_gain
from treadline.core import paper
from treadline.experiments.as_printed import asked_at

K = lqr_gain(paper.A, paper.B, paper.Q, paper.R)
print(f"largest gap to Eq. (14): {np.abs(K - paper.K).max():.1e}")
left, right = asked_at(30.0)
print(f"at 30° it asks {left:+.2f} m/s of the left track and {right:+.2f} m/s of the right; they can do {paper.MAX_SPEED_M_S:g}")
