"""Exception classes of treadline, as one tree.

::

    TreadlineError                       any expected failure (exit code 2)
    ├── SettingsError                    a scenario, chair, camera or model file is missing or invalid
    ├── RecordError                      a log or record cannot be used as data
    │   ├── LogFormatError               the file is damaged, or not in the format of its name
    │   ├── ShapeMismatch                array shapes do not match
    │   ├── NotFinite                    NaN or Inf where a number is required
    │   └── PoorExcitation               the inputs do not excite the requested order
    │       ├── DependentInputs          an input is constant, or moves with others alone
    │       └── TooFewSamples            the record is too short, or its gaps leave too little data
    ├── ModelError                       a model is unsuitable for the purpose
    │   ├── NotStabilisable              no gain makes A - BK stable
    │   ├── NotDetectable                no observer makes A - LC stable
    │   ├── NotInvertible                C - DK has no inverse
    │   ├── NotDefinite                  a weight is not (semi-)definite
    │   └── PeriodMismatch               two different sampling periods where one is required
    ├── ImageError                       an image or its calibration cannot be used
    ├── CameraError                      a live depth camera is missing, busy, or has stopped
    ├── LinkError                        a drive or sensor of a real chair is missing, busy, or has gone
    ├── MechanicsError                   an impossible geometry
    ├── GazeboError                      Gazebo is not installed, does not start, or has exited
    └── SimulationDiverged               the simulation is numerically invalid and has no result (exit code 1)
"""

import re
from collections.abc import Iterable
from difflib import get_close_matches


class TreadlineError(Exception):
    """Base of every expected failure; its message fits one line and names a remedy."""


class SettingsError(TreadlineError):
    """A settings file is missing, unreadable, or contains an invalid key or value."""


class RecordError(TreadlineError):
    """A log or record cannot be used as data."""


class LogFormatError(RecordError):
    """A file is damaged, or not in the format of its name."""


class ShapeMismatch(RecordError):
    """Shapes of related arrays do not match."""


class NotFinite(RecordError):
    """NaN or Inf where a number is required."""


class PoorExcitation(RecordError):
    """The inputs do not excite the requested order."""


class DependentInputs(PoorExcitation):
    """An input is constant, or a linear combination of the others."""


class TooFewSamples(PoorExcitation):
    """A record is too short for the request, or its gaps leave too little data."""


class ModelError(TreadlineError):
    """A model is unsuitable for the purpose."""


class NotStabilisable(ModelError):
    """No gain makes ``A - BK`` stable."""


class NotDetectable(ModelError):
    """No observer gain makes ``A - LC`` stable."""


class NotInvertible(ModelError):
    """``C - DK`` has no inverse, so Eq. (11b) has no solution."""


class NotDefinite(ModelError):
    """A weight matrix is not symmetric positive (semi-)definite."""


class PeriodMismatch(ModelError):
    """A model and its user have different sampling periods."""


class ImageError(TreadlineError):
    """An image or its calibration cannot be used."""


class CameraError(TreadlineError):
    """A live depth camera is missing, busy, or has stopped."""


class LinkError(TreadlineError):
    """A drive or sensor of a real chair is missing, busy, of another protocol version, or has gone."""


class MechanicsError(TreadlineError):
    """An impossible geometry."""


class GazeboError(TreadlineError):
    """Gazebo is not installed, does not start, or has exited."""


class SimulationDiverged(TreadlineError):
    """The simulation is numerically invalid (a warning, time running backwards, a non-finite state)."""


def one_line(error: Exception, most: int = 200) -> str:
    """Return the message of an error on one line of limited length: names out of a file, and vendors' texts, may hold anything."""
    return " ".join(str(error).split())[:most]


def closest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that is most similar to a misspelt one, or None; other digits name another thing, as of two cameras."""
    alike = [other for other in known if re.sub(r"\D", "", other) == re.sub(r"\D", "", name)]
    return next(iter(get_close_matches(name, alike, 1)), None)


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the end of a message that asks for the known name most similar to a misspelt one; empty if none is."""
    return f"; did you mean '{close}'?" if (close := closest(name, known)) else ""
