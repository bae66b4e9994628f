"""What the data can tell: lags, feedthrough and order, each by a rule that is written down.

Lags and feedthrough by Schwarz's criterion, order by the largest gap of the singular values above the noise floor.
"""

import numpy as np
from jaxtyping import Float

from treadline.identification.era import HankelSvd
from treadline.identification.gram import Gram
from treadline.identification.okid import ObserverMarkov, regression, residuals_by_feedthrough, residuals_by_lags
from treadline.identification.order import OrderChoice, choose_order, stands_out
from treadline.identification.realisation import markov_svd

EXACT = 1e-12
"""Residual variance over the outputs' variance at which data are free of noise."""


def choose_structure(whole: Gram, lags: int | None, feedthrough: bool | None) -> tuple[int, bool]:
    """Return lags and feedthrough by Schwarz's criterion: fit against the number of coefficients."""
    if lags is not None and feedthrough is not None:
        return lags, feedthrough
    if lags is not None:
        both = residuals_by_feedthrough(whole, lags)
        tables = {has_d: None if both is None else {lags: both[int(has_d)]} for has_d in (False, True)}
    else:
        kinds = (False, True) if feedthrough is None else (feedthrough,)
        tables = {has_d: _by_lags(residuals_by_lags(whole, feedthrough=has_d)) for has_d in kinds}
    costs = {}
    for has_d, table in tables.items():
        for p in range(1, whole.lags + 1) if lags is None else (lags,):
            left = regression(whole, p, feedthrough=has_d).solve()[1] if table is None else table[p]
            costs[p, has_d] = _schwarz(whole, left, p, has_d)
    return min(costs, key=lambda key: costs[key])


def _by_lags(squares: Float[np.ndarray, "lags p p"] | None) -> dict[int, Float[np.ndarray, "p p"]] | None:
    return None if squares is None else dict(enumerate(squares, start=1))


def _schwarz(whole: Gram, squares: Float[np.ndarray, "p p"], lags: int, feedthrough: bool) -> float:
    m, r = whole.units.input_count, len(whole.units.scale)
    values = np.linalg.eigvalsh(0.5 * (squares + squares.T) / whole.count)
    # Residuals below rounding are all the same: exact.
    floor = 1e-20 * (r - m)
    coefficients = (1 + (m if feedthrough else 0) + lags * r) * (r - m)
    return whole.count * float(np.sum(np.log(np.maximum(values, floor)))) + coefficients * np.log(whole.count)


def structural_order(observer: ObserverMarkov) -> int | None:
    """Return the rank that p lags alone give the Hankel matrix; None where the observer is exact, so that it is real.

    Args:
        observer: In units of deviations.
    """
    exact = np.trace(observer.residual_covariance) < EXACT * len(observer.D)
    return None if exact else observer.beta.shape[0] * observer.beta.shape[1]


def noise_level(first: ObserverMarkov, second: ObserverMarkov, order: int | None) -> float:
    """Return the largest singular value that noise alone would show: half of what two halves of the data differ by."""
    difference = markov_svd(first, order).matrix - markov_svd(second, order).matrix
    return 0.5 * float(np.linalg.norm(difference, 2))


def settle_order(svd: HankelSvd, order: int | None, structural: int | None, noise: float, warnings: list[str]) -> OrderChoice:
    """Return the order asked for, or the one the singular values show; a doubt goes to the warnings."""
    # An observer of p lags has no more than p states per output: the drop after those says nothing of the system.
    choice = choose_order(svd.s[:structural], noise=noise)
    if order is not None:
        following = float(svd.s[order]) if order < svd.s.size else 0.0
        gap = float(svd.s[min(order, svd.s.size) - 1]) / following if following > 0.0 else float("inf")
        return OrderChoice(order=order, gap=gap, clear=True)
    if not stands_out(svd.s, noise):
        warnings.append(
            f"no clear gap in the singular values (the largest is {svd.s[0] / noise:.1f} times what noise alone shows); "
            "give more data, or inputs that move more"
        )
    elif not choice.clear:
        warnings.append(
            f"no clear gap in the singular values (largest ratio {choice.gap:.1f} at order {choice.order}); "
            "give --order, or more data"
        )
    return choice
