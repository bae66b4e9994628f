"""From recorded belt speeds and motion to a linear model."""

from treadline.identification.era import era
from treadline.identification.identify import METHODS, IdentificationReport, Identified, identify
from treadline.identification.okid import observer_markov, system_markov

__all__ = ["METHODS", "IdentificationReport", "Identified", "era", "identify", "observer_markov", "system_markov"]
