"""The errors treadline raises, as one tree.

::

    TreadlineError                       anything a caller may expect to go wrong (exit code 2)
    ├── SettingsError                    a scenario, chair, camera or model file says something it must not
    ├── RecordError                      a log or record cannot be used as data
    │   ├── LogFormatError               the file is not what its name says, or is broken
    │   ├── ShapeMismatch                arrays do not fit each other
    │   ├── NotFinite                    NaN or Inf where a number must stand
    │   └── PoorExcitation               the inputs do not excite what is asked for
    │       └── TooFewSamples            the record is too short for it, or its gaps leave too little
    ├── ModelError                       a model cannot serve the purpose
    │   ├── NotStabilisable              no gain makes A - BK stable
    │   ├── NotDetectable                no observer makes A - LC stable
    │   ├── NotInvertible                C - DK has no inverse
    │   ├── NotDefinite                  a weight is not (semi-)definite
    │   └── PeriodMismatch               two clocks where one is needed
    ├── ImageError                       an image or its calibration cannot be used
    ├── MechanicsError                   a geometry that cannot exist
    ├── GazeboError                      Gazebo is not there, does not start, or has died
    └── SimulationDiverged               the simulator left physics: never a result from it (exit code 1)
"""


class TreadlineError(Exception):
    """Base of every expected failure; its message fits one line and names a remedy."""


class SettingsError(TreadlineError):
    """A settings file is missing, unreadable, or holds a key or value it must not."""


class RecordError(TreadlineError):
    """A log or record cannot be used as data."""


class LogFormatError(RecordError):
    """A file is not in the format it claims, or is broken."""


class ShapeMismatch(RecordError):
    """Arrays whose shapes must agree do not."""


class NotFinite(RecordError):
    """NaN or Inf where a number must stand."""


class PoorExcitation(RecordError):
    """The inputs do not excite the order that is asked for."""


class TooFewSamples(PoorExcitation):
    """A record is too short for what is asked, or its gaps leave too little of it."""


class ModelError(TreadlineError):
    """A model cannot serve the purpose."""


class NotStabilisable(ModelError):
    """No gain makes ``A - BK`` stable."""


class NotDetectable(ModelError):
    """No observer gain makes ``A - LC`` stable."""


class NotInvertible(ModelError):
    """``C - DK`` has no inverse, so Eq. (11b) has no answer."""


class NotDefinite(ModelError):
    """A weight matrix is not symmetric positive (semi-)definite."""


class PeriodMismatch(ModelError):
    """A model and its user run on different clocks."""


class ImageError(TreadlineError):
    """An image or its calibration cannot be used."""


class MechanicsError(TreadlineError):
    """A geometry that cannot exist."""


class GazeboError(TreadlineError):
    """Gazebo is not there, does not start, or has died."""


class SimulationDiverged(TreadlineError):
    """The simulator left physics (a warning, time going back, a state that is not finite)."""
