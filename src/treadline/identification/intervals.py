"""How sure the poles are: the fit again with each part of the data left out (jackknife)."""

from dataclasses import replace

import numpy as np
from jaxtyping import Complex

from treadline.identification.era import realise
from treadline.identification.gram import Gram
from treadline.identification.okid import observer_markov
from treadline.identification.realisation import markov_svd
from treadline.identification.windows import Scales, joined, leading


def pole_intervals(
    parts: list[Gram], lags: int, feedthrough: bool, order: int, scales: Scales, poles: Complex[np.ndarray, " n"]
) -> list[float]:
    """Return the half width of each pole's 95 % interval: the fit with each part left out in turn."""
    whole = joined(parts)
    found = []
    for item in parts:
        rest = replace(whole, XX=whole.XX - item.XX, XY=whole.XY - item.XY, YY=whole.YY - item.YY, count=whole.count - item.count)
        svd = markov_svd(observer_markov(leading(rest, lags, feedthrough)), lags, order, scales)
        found.append(_nearest(np.linalg.eigvals(realise(svd, order, *scales)[0]).astype(complex), poles))
    values = np.array(found)
    k = len(parts)
    variance = (k - 1) / k * np.sum(np.abs(values - values.mean(axis=0)) ** 2, axis=0)
    return [float(1.96 * np.sqrt(value)) for value in variance]


def _nearest(found: Complex[np.ndarray, " n"], poles: Complex[np.ndarray, " n"]) -> list[complex]:
    left = [complex(pole) for pole in found]
    ordered = []
    for pole in poles:
        best = min(left, key=lambda other: abs(other - pole))
        left.remove(best)
        ordered.append(best)
    return ordered
