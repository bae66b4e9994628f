"""Numbers that several steps of an identification share."""

ROUNDING = 1e-13
"""Relative size of a variance, an eigenvalue or a singular value below which only rounding remains."""
PREDICTABLE = 1e-9
"""Share of an input's variance that is new in a sample, below which the input is predictable from its own past."""
SIGNIFICANCE = 1e-4
"""p-value below which an influence is significant."""
HALF = 0.5
"""Share of a variance above which one cause explains more of it than all others."""
TOLERANCE = 0.3
"""Relative error of a yaw gain that needs a warning."""
LAGS_MOST = 40
"""Largest number of lags, and of states, that is tried."""
RECENT = 20_000
"""Most recent samples of steps whose result more samples would hardly change: dead time, yaw gain, and scores."""
ROWS_PER_PARAMETER = 8
"""Windows per coefficient of one output for automatically chosen lags."""
ROWS_LEAST = 2
"""Windows per coefficient that must be exceeded for a given number of lags, and for the penalised regression of ``best``."""
