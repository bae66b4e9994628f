"""Sums of squares of a free run in modal coordinates, where each state is one scalar filter of one input.

With A = V diag(λ) V⁻¹ an output is linear in the modal B, in D and in the initial state, and its derivatives with respect
to λ, B, C and D are filters of signals that are there already. Their sums of products cost N·(n·m)² at the speed of matrix
products, where the recursion of all derivatives costs N·n²·d one by one.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int, Num

from treadline.identification.affine import Affine
from treadline.identification.kernels import modal_chain, modal_filters

ILL_CONDITIONED = 1e5
"""Condition of the modes beyond which modal coordinates lose too many digits: poles (nearly) coincide."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Modes:
    """A = V diag(poles) V⁻¹ and C V."""

    poles: Complex[np.ndarray, " n"]
    V: Complex[np.ndarray, "n n"]
    W: Complex[np.ndarray, "n n"]
    """V⁻¹."""
    C: Complex[np.ndarray, "p n"]


def modes_of(system: Affine) -> Modes | None:
    """Return the modes, or None where they are too ill conditioned."""
    if not np.isfinite(system.A).all():
        return None
    poles, V = np.linalg.eig(system.A)
    try:
        W = np.linalg.inv(V)
    except np.linalg.LinAlgError:
        return None
    if not np.linalg.norm(V) * np.linalg.norm(W) < ILL_CONDITIONED:
        return None
    return Modes(poles=poles.astype(complex), V=V.astype(complex), W=W.astype(complex), C=(system.C @ V).astype(complex))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalSums:
    """J'J and J'e over modal B (i, j), then λ (i) and C (o, i) if asked for, then D (o, j); initial state eliminated."""

    square: Complex[np.ndarray, "d d"]
    right: Complex[np.ndarray, " d"]


def linear_sums(
    modes: Modes, u: Float[np.ndarray, "T m1"], y: Float[np.ndarray, "T p"], there: Bool[np.ndarray, " T"]
) -> ModalSums:
    """Return the sums for modal B and D, about a system without them."""
    n, m1 = len(modes.poles), u.shape[1]
    f = modal_filters(modes.poles, u)
    shared = np.concatenate([f[:, :, :m1].reshape(len(f), -1), f[:, :, m1]], axis=1)
    mode = np.concatenate([np.repeat(np.arange(n), m1), np.arange(n)])
    return _sums(modes, shared, mode, u, y, there)


def derivative_sums(
    modes: Modes, system: Affine, u: Float[np.ndarray, "T m1"], y: Float[np.ndarray, "T p"], there: Bool[np.ndarray, " T"]
) -> ModalSums:
    """Return the sums for modal B, λ, C and D about a system."""
    n, m1 = len(modes.poles), u.shape[1]
    f = modal_filters(modes.poles, u)
    decay = f[:, :, m1]
    x = np.einsum("kij,ij->ki", f[:, :, :m1], modes.W @ system.B)
    e = y - (x @ modes.C.T).real - u @ system.D.T
    if not there.all():
        e[~there] = 0.0
    shift = decay * _start(modes, decay, e, there)
    x, e = x + shift, e - (shift @ modes.C.T).real
    shared = np.concatenate([f[:, :, :m1].reshape(len(u), -1), modal_chain(modes.poles, x), decay], axis=1)
    mode = np.concatenate([np.repeat(np.arange(n), m1), np.arange(n), np.arange(n)])
    return _sums(modes, shared, mode, np.concatenate([x, u], axis=1), e, there)


def _start(
    modes: Modes, decay: Complex[np.ndarray, "T n"], e: Float[np.ndarray, "T p"], there: Bool[np.ndarray, " T"]
) -> Complex[np.ndarray, " n"]:
    """Return the modal initial state that explains e best."""
    seen = decay if there.all() else decay * there[:, None]
    square = (modes.C.conj().T @ modes.C) * (seen.conj().T @ seen)
    right = np.einsum("oi,io->i", modes.C.conj(), seen.conj().T @ e)
    return _pseudo_inverse(square) @ right


def _sums(
    modes: Modes,
    shared: Complex[np.ndarray, "T w"],
    mode: Int[np.ndarray, " w"],
    own: Num[np.ndarray, "T v"],
    e: Float[np.ndarray, "T p"],
    there: Bool[np.ndarray, " T"],
) -> ModalSums:
    """Return sums over columns that reach all outputs by C, and over columns that are one output's own.

    Args:
        shared: Signals of a mode each; the last n are the initial state's, which is eliminated.
        mode: Which mode each of them is of.
        own: Signals that enter one output alone, the same for each.
        e: What is to be explained.
    """
    n, p = len(modes.poles), e.shape[1]
    width, v = shared.shape[1], own.shape[1]
    signals = np.concatenate([shared, own, e], axis=1)
    if not there.all():
        signals[~there] = 0.0
    products = signals.conj().T @ signals
    C = modes.C[:, mode]
    square = np.zeros((width + p * v, width + p * v), dtype=complex)
    right = np.zeros(width + p * v, dtype=complex)
    square[:width, :width] = (C.conj().T @ C) * products[:width, :width]
    for o in range(p):
        at = slice(width + o * v, width + (o + 1) * v)
        square[:width, at] = C[o].conj()[:, None] * products[:width, width : width + v]
        square[at, :width] = square[:width, at].conj().T
        square[at, at] = products[width : width + v, width : width + v]
        right[at] = products[width : width + v, width + v + o]
    right[:width] = np.einsum("ow,wo->w", C.conj(), products[:width, width + v :])
    start = slice(width - n, width)
    kept = np.concatenate([np.arange(width - n), np.arange(width, width + p * v)])
    cross = square[kept, start] @ _pseudo_inverse(square[start, start])
    return ModalSums(square=square[np.ix_(kept, kept)] - cross @ square[start, kept], right=right[kept] - cross @ right[start])


def _pseudo_inverse(square: Complex[np.ndarray, "n n"]) -> Complex[np.ndarray, "n n"]:
    """Return the inverse of a normal matrix; directions that leave no trace count for nothing."""
    values, vectors = np.linalg.eigh(square)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return (vectors[:, kept] / values[kept]) @ vectors[:, kept].conj().T
