"""Model order, lags and feedthrough, by singular values and information criteria.

Lags and feedthrough minimise the BIC; lags of an observer that is itself the model minimise the AICc. The order is at the largest
ratio of neighbouring singular values, among values above the noise floor: the median of the lower half, and 1.5 times the noise
level by the errors of the regression. The choice is unclear for a ratio below ``CLEAR_GAP``, or if noise alone may be as large.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from treadline.identification._era import HankelSvd, hankel, largest
from treadline.identification._gram import Gram
from treadline.identification._limits import LAGS_MOST, ROUNDING
from treadline.identification._okid import ObserverMarkov, residuals_by_lags, system_markov
from treadline.identification._realisation import StateMap, innovations

CLEAR_GAP = 4.0
"""Smallest ratio of neighbouring singular values that counts as a gap; white noise stays below 2."""
ABOVE_NOISE = 3.0
"""Ratio of the largest singular value to the noise level above which the data show a system; white noise reaches 2."""
FURTHER_ABOVE_NOISE = 1.5
"""Ratio to the noise level for further states; on stairs the second reached 8.6 in a minute of data, the third at most 1.2."""
NOISE_DRAWS = 4
"""Draws of the noise: the deviation of their root mean square is a quarter of it for one lag, and less for more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderChoice:
    """Model order and whether the gap at that order is clear."""

    order: int
    gap: float
    """Gap σ_n / σ_{n+1}."""
    clear: bool


def gap_at(singular_values: Float[np.ndarray, " k"], order: int) -> float:
    """Return the gap σ_n / σ_{n+1} at order n."""
    s = singular_values
    return float(s[order - 1] / s[order]) if order < s.size and s[order] > 0.0 else float("inf")


def stands_out(singular_values: Float[np.ndarray, " k"], noise: float) -> bool:
    """Whether the largest singular value exceeds the noise level significantly."""
    return bool(singular_values[0] > ABOVE_NOISE * noise)


def choose_order(
    singular_values: Float[np.ndarray, " k"], *, noise: float = 0.0, allowed: Sequence[int] | None = None
) -> OrderChoice:
    """Return the order at the largest gap.

    Args:
        singular_values: Singular values of the Hankel matrix, in descending order.
        noise: Largest singular value of noise alone.
        allowed: Orders to choose from; any when None. The smallest if none of them is above the noise.
    """
    s = np.maximum(singular_values, ROUNDING * singular_values[0])
    candidates = len(s) - 1
    least = 1 if allowed is None else min(allowed)
    if candidates < least:
        return OrderChoice(order=least, gap=float("inf"), clear=stands_out(s, noise))
    lower = s[len(s) // 2 :]  # already sorted, so the median is in the middle
    floor = 0.5 * float(lower[(len(lower) - 1) // 2] + lower[len(lower) // 2])
    ratios = s[:candidates] / s[1 : candidates + 1]
    above = s[:candidates] > max(floor, FURTHER_ABOVE_NOISE * noise)
    above[least - 1] = True
    if allowed is not None:
        above &= np.isin(np.arange(1, candidates + 1), allowed)
    best = int(np.argmax(np.where(above, ratios, 0.0)))
    clear = bool(ratios[best] >= CLEAR_GAP and stands_out(s, noise))
    return OrderChoice(order=best + 1, gap=float(ratios[best]), clear=clear)


def choose_structure(whole: Gram, lags: int | None, feedthrough: bool | None, *, is_model: bool = False) -> tuple[int, bool]:
    """Return lags and feedthrough at the smallest BIC.

    Args:
        whole: Gram matrix of all data.
        lags: Given lags; chosen when None.
        feedthrough: Given feedthrough; chosen when None.
        is_model: Whether the model is a realisation of the observer; truncated lags are then bias, and the AICc decides.
    """
    if lags is not None and feedthrough is not None:
        return lags, feedthrough
    choices, values = _bic(whole, lags, feedthrough)
    used, has_d = choices[int(np.argmin(values))]
    return (_aicc_lags(whole, feedthrough=has_d) if is_model and lags is None else used), has_d


def min_bic(whole: Gram, lags: int | None, feedthrough: bool | None) -> float:
    """Return the smallest BIC over lags and feedthrough; comparable between different inputs for the same outputs."""
    return float(_bic(whole, lags, feedthrough)[1].min())


def _bic(whole: Gram, lags: int | None, feedthrough: bool | None) -> tuple[list[tuple[int, bool]], Float[np.ndarray, " k"]]:
    """Return all open combinations of lags and feedthrough with their BIC."""
    tried = range(1, whole.lags + 1) if lags is None else range(lags, lags + 1)
    kinds = (False, True) if feedthrough is None else (feedthrough,)
    residual_ss = residuals_by_lags(whole, tried, kinds)
    choices = [(p, has_d) for has_d in kinds for p in tried]
    return choices, _deviances(whole, np.concatenate(residual_ss)) + _coefficients(whole, choices) * np.log(whole.count)


def _aicc_lags(whole: Gram, *, feedthrough: bool) -> int:
    """Return the lags at the smallest AICc (Akaike's criterion for short data: Hurvich and Tsai, 1989).

    The observer of measured outputs has infinitely many lags. The BIC, which assumes a finite true number, stops at a bias as
    large as the standard deviation; the AIC increases the lags with the data (Shibata, 1980).
    """
    choices = [(lags, feedthrough) for lags in range(1, whole.lags + 1)]
    residual_ss = residuals_by_lags(whole, range(1, whole.lags + 1), (feedthrough,))[0]
    count, p = _coefficients(whole, choices), residual_ss.shape[1]
    spare = np.maximum(whole.count - count / p - p - 1.0, 1.0)
    return int(np.argmin(_deviances(whole, residual_ss) + 2.0 * count * whole.count / spare)) + 1


def _deviances(whole: Gram, squares: Float[np.ndarray, "k p p"]) -> Float[np.ndarray, " k"]:
    values = np.linalg.eigvalsh(0.5 * (squares + squares.transpose(0, 2, 1)) / whole.count)
    # Residuals below rounding count as equal.
    return np.asarray(whole.count * np.log(np.maximum(values, 1e-20 * squares.shape[1])).sum(axis=1))


def _coefficients(whole: Gram, choices: Sequence[tuple[int, bool]]) -> Float[np.ndarray, " k"]:
    m, r = whole.units.input_count, len(whole.units.scale)
    return np.array([float((1 + m * has_d + lags * r) * (r - m)) for lags, has_d in choices])


def bic_order(data: Gram, states: StateMap, lags: int, *, feedthrough: bool, allowed: Sequence[int] | None = None) -> int:
    """Return the order of PBSID's state map with the smallest BIC.

    A gap identifies an order that stands out; singular values of measured data mostly decay without a gap.

    Args:
        allowed: Orders to choose from; any up to ``LAGS_MOST`` when None.
    """
    m, p = data.units.input_count, len(data.units.scale) - data.units.input_count
    most = min(LAGS_MOST if allowed is None else max(allowed), len(states.s))
    deviances = _deviances(data, innovations(data, states, most, lags, feedthrough=feedthrough))
    # Number of parameters of A, B, C and K in canonical form: 2p + m per state; the rest does not depend on the order.
    costs = deviances + np.arange(1, most + 1) * (2 * p + m) * np.log(data.count)
    if allowed is not None and min(allowed) > most:
        return min(allowed)
    open_to_choice = np.isin(np.arange(1, most + 1), range(1, most + 1) if allowed is None else allowed)
    return int(np.argmin(np.where(open_to_choice, costs, np.inf))) + 1


def structural_order(observer: ObserverMarkov) -> int | None:
    """Return the largest order that p lags allow for the Hankel matrix; None for an exact observer, whose rank is genuine.

    Args:
        observer: OKID observer in standard deviations.
    """
    exact = np.trace(observer.residual_covariance) < ROUNDING * len(observer.D)
    return None if exact else observer.beta.shape[0] * observer.beta.shape[1]


def noise_level(observer: ObserverMarkov, svd: HankelSvd) -> float:
    """Return the largest singular value of noise alone, by the root mean square of draws of the regression's own errors.

    Args:
        observer: OKID observer in standard deviations.
        svd: Its decomposed Hankel matrix.
    """
    # The difference of two Hankel matrices is the Hankel matrix of the difference.
    draws = [system_markov(one, len(svd.markov)) - svd.markov for one in observer.draws(NOISE_DRAWS)]
    if not np.max(np.abs(draws)) < np.sqrt(np.finfo(float).max) / svd.rows:  # errors that make the observer diverge
        return float("inf")
    return float(np.sqrt(np.mean([largest(hankel(draw, svd.rows, svd.columns, 0)) ** 2 for draw in draws])))


def no_system(singular_values: Float[np.ndarray, " k"], noise: float) -> list[str]:
    """Return a warning if noise alone may cause the largest singular value."""
    if stands_out(singular_values, noise):
        return []
    return [
        f"no clear gap in the singular values (the largest is {singular_values[0] / noise:.1f} times the noise level); "
        "give more data, or inputs that vary more"
    ]


def settle_order(
    singular_values: Float[np.ndarray, " k"], noise: float, warnings: list[str], allowed: Sequence[int] | None = None
) -> OrderChoice:
    """Return the order at the gap of the singular values; an unclear gap adds a warning.

    An observer of p lags has at most p states per output; the drop beyond that rank is an artefact and left out by the caller.
    """
    choice = choose_order(singular_values, noise=noise, allowed=allowed)
    warnings += (lacking := no_system(singular_values, noise))
    if not lacking and not choice.clear:
        warnings.append(
            f"no clear gap in the singular values (largest ratio {choice.gap:.1f} at order {choice.order}); "
            "give --order, or more data"
        )
    return choice
