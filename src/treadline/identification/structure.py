"""What the data can tell: lags, feedthrough and order, each by a rule that is written down.

Lags and feedthrough by Schwarz's criterion, lags of an observer that is the model itself by Akaike's, order by the largest
gap of the singular values above the noise floor.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from treadline.identification.era import HankelSvd, hankel, largest
from treadline.identification.gram import Gram
from treadline.identification.okid import ObserverMarkov, residuals_by_lags, system_markov
from treadline.identification.order import OrderChoice, choose_order, gap_at, stands_out
from treadline.identification.pbsid import StateMap, innovations

ORDER_MOST = 16
"""Largest order that is tried."""
EXACT = 1e-12
"""Residual variance over the outputs' variance at which data are free of noise."""


def choose_structure(whole: Gram, lags: int | None, feedthrough: bool | None, *, is_model: bool = False) -> tuple[int, bool]:
    """Return lags and feedthrough by Schwarz's criterion: fit against the number of coefficients.

    Args:
        is_model: Whether the model is the observer's own: what its lags leave out is then bias, and Akaike's criterion decides.
    """
    if lags is not None and feedthrough is not None:
        return lags, feedthrough
    choices, values = _by_schwarz(whole, lags, feedthrough)
    used, has_d = choices[int(np.argmin(values))]
    return (_akaike_lags(whole, feedthrough=has_d) if is_model and lags is None else used), has_d


def least_schwarz(whole: Gram, lags: int | None, feedthrough: bool | None) -> float:
    """Return Schwarz's criterion of the lags and the feedthrough that it takes: by it, other inputs to the same outputs compare."""
    return float(_by_schwarz(whole, lags, feedthrough)[1].min())


def _by_schwarz(whole: Gram, lags: int | None, feedthrough: bool | None) -> tuple[list[tuple[int, bool]], Float[np.ndarray, " k"]]:
    """Return all lags and feedthroughs that are open, and the criterion of each."""
    tried = range(1, whole.lags + 1) if lags is None else range(lags, lags + 1)
    kinds = (False, True) if feedthrough is None else (feedthrough,)
    left = residuals_by_lags(whole, tried, kinds)
    choices = [(p, has_d) for has_d in kinds for p in tried]
    return choices, _misfits(whole, np.concatenate(left)) + _coefficients(whole, choices) * np.log(whole.count)


def _akaike_lags(whole: Gram, *, feedthrough: bool) -> int:
    """Return the lags by Akaike's criterion, corrected for short data (Hurvich and Tsai, 1989).

    The observer of measured outputs has lags without end. Schwarz's criterion, which looks for a true number of them, stops where
    what it leaves out is a bias as large as the deviation; Akaike's goes on with the data (Shibata, 1980).
    """
    choices = [(lags, feedthrough) for lags in range(1, whole.lags + 1)]
    left = residuals_by_lags(whole, range(1, whole.lags + 1), (feedthrough,))[0]
    count, p = _coefficients(whole, choices), left.shape[1]
    spare = np.maximum(whole.count - count / p - p - 1.0, 1.0)
    return int(np.argmin(_misfits(whole, left) + 2.0 * count * whole.count / spare)) + 1


def _misfits(whole: Gram, squares: Float[np.ndarray, "k p p"]) -> Float[np.ndarray, " k"]:
    values = np.linalg.eigvalsh(0.5 * (squares + squares.transpose(0, 2, 1)) / whole.count)
    # Residuals below rounding are all the same: exact.
    return np.asarray(whole.count * np.log(np.maximum(values, 1e-20 * squares.shape[1])).sum(axis=1))


def _coefficients(whole: Gram, choices: Sequence[tuple[int, bool]]) -> Float[np.ndarray, " k"]:
    m, r = whole.units.input_count, len(whole.units.scale)
    return np.array([float((1 + m * has_d + lags * r) * (r - m)) for lags, has_d in choices])


def schwarz_order(data: Gram, states: StateMap, lags: int, *, feedthrough: bool) -> int:
    """Return the order whose predictor is worth its coefficients by Schwarz's criterion, of those PBSID's states show.

    A gap tells an order that stands out; on measured data singular values mostly fall without one.
    """
    m, p = data.units.input_count, len(data.units.scale) - data.units.input_count
    most = min(ORDER_MOST, len(states.s))
    left = innovations(data, states, most, lags, feedthrough=feedthrough)
    floor = 1e-20 * p  # below rounding all are the same: exact
    values = np.maximum(np.linalg.eigvalsh(0.5 * (left + left.transpose(0, 2, 1))), floor)
    # A, B, C and K in canonical form: 2p + m per state; the rest is the same for all.
    costs = data.count * np.log(values).sum(axis=1) + np.arange(1, most + 1) * (2 * p + m) * np.log(data.count)
    return int(np.argmin(costs)) + 1


def structural_order(observer: ObserverMarkov) -> int | None:
    """Return the rank that p lags alone give the Hankel matrix; None where the observer is exact, so that it is real.

    Args:
        observer: In units of deviations.
    """
    exact = np.trace(observer.residual_covariance) < EXACT * len(observer.D)
    return None if exact else observer.beta.shape[0] * observer.beta.shape[1]


def noise_level(part: ObserverMarkov, whole: ObserverMarkov, svd: HankelSvd) -> float:
    """Return the largest singular value that noise alone would show: by how much a half of the data differs from the whole.

    Of noise of variance v per sample, n samples of N leave v/n, all v/N, and their difference v/n - v/N.

    Args:
        part: Of the half, in units of deviations.
        whole: The same of all data.
        svd: The whole's Hankel matrix.
    """
    # The difference of two Hankel matrices is that of the differences.
    difference = system_markov(part, len(svd.markov)) - svd.markov
    return float(np.sqrt(part.count / max(whole.count - part.count, 1.0))) * largest(hankel(difference, svd.rows, svd.columns, 0))


def gap_of(choice: OrderChoice, svd: HankelSvd) -> float:
    """Return σ_n / σ_{n+1} of a choice; where the order was given, it is read off only here."""
    return gap_at(svd.s, choice.order) if choice.gap is None else choice.gap


def settle_order(svd: HankelSvd, order: int | None, structural: int | None, noise: float, warnings: list[str]) -> OrderChoice:
    """Return the order asked for, or the one the singular values show; a doubt goes to the warnings."""
    if order is not None:
        return OrderChoice(order=order, gap=None, clear=True)
    # An observer of p lags has no more than p states per output: the drop after those says nothing of the system.
    choice = choose_order(svd.s[:structural], noise=noise)
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
