"""What the data can tell: lags, feedthrough and order, each by a rule that is written down.

Lags and feedthrough by Schwarz's criterion, order by the largest gap of the singular values above the noise floor.
"""

import numpy as np

from treadline.identification.era import HankelSvd
from treadline.identification.gram import Gram
from treadline.identification.okid import ObserverMarkov, observer_markov, solve_normal
from treadline.identification.order import OrderChoice, choose_order, stands_out
from treadline.identification.realisation import markov_svd
from treadline.identification.windows import Scales, joined, leading
from treadline.models import InputOutputRecord

EXACT = 1e-12
"""Residual variance over the outputs' variance at which data are free of noise."""


def choose_structure(whole: Gram, lags: int | None, feedthrough: bool | None) -> tuple[int, bool]:
    """Return lags and feedthrough by Schwarz's criterion: fit against the number of coefficients."""
    tried_lags = [lags] if lags is not None else range(1, whole.lags + 1)
    tried_d = [feedthrough] if feedthrough is not None else [False, True]
    costs = {(p, has_d): _schwarz(leading(whole, p, has_d)) for p in tried_lags for has_d in tried_d}
    return min(costs, key=lambda key: costs[key])


def _schwarz(data: Gram) -> float:
    theta, _ = solve_normal(data.XX, data.XY)
    residual = data.YY - theta.T @ data.XY
    values = np.linalg.eigvalsh(0.5 * (residual + residual.T) / data.count)
    # Residuals below rounding are all the same: exact.
    floor = 1e-20 * float(np.trace(data.YY)) / data.count
    return data.count * float(np.sum(np.log(np.maximum(values, floor)))) + theta.size * np.log(data.count)


def structural_order(observer: ObserverMarkov | None, records: list[InputOutputRecord]) -> int | None:
    """Return the rank that p lags alone give the Hankel matrix; None where the observer is exact, so that it is real."""
    if observer is None:
        return None
    y = np.vstack([record.y for record in records])
    exact = np.trace(observer.residual_covariance) < EXACT * np.sum(np.nanvar(y, axis=0))
    return None if exact else observer.beta.shape[0] * observer.beta.shape[1]


def noise_level(parts: list[Gram], lags: int, feedthrough: bool, order: int | None, scales: Scales) -> float:
    """Return the largest singular value that noise alone would show: half of what two halves of the data differ by."""
    if len(parts) < 2:
        return 0.0
    halves = [joined(parts[::2]), joined(parts[1::2])]
    first, second = (markov_svd(observer_markov(leading(half, lags, feedthrough)), lags, order, scales) for half in halves)
    return 0.5 * float(np.linalg.norm(first.matrix - second.matrix, 2))


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
