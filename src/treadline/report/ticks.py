"""Tick labels of logarithmic axes as plain text (``10⁻³``).

matplotlib writes them as formulas by default. The formula layout loads some twenty mathematical fonts and warns about each that the
font list of the machine does not have.
"""

import re

from matplotlib.axis import Axis
from matplotlib.ticker import LogFormatterSciNotation, NullFormatter

SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


class PlainLogFormatter(LogFormatterSciNotation):
    """Formatter of powers of ten and their multiples, without formula markup."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the label of a tick."""
        text = super().__call__(x, pos).removeprefix(r"$\mathdefault{").removesuffix("}$")
        text = re.sub(r"\^\{(-?\d+)\}", lambda exponent: exponent[1].translate(SUPERSCRIPTS), text)
        return text.replace(r"\times", "×").replace("-", "−")


def plain_log_labels(axis: Axis) -> None:
    """Replace the formatters of a logarithmic axis."""
    axis.set_major_formatter(PlainLogFormatter())
    if not isinstance(axis.get_minor_formatter(), NullFormatter):
        axis.set_minor_formatter(PlainLogFormatter(labelOnlyBase=False))
