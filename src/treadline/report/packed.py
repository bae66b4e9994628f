"""Arrays in a page: 16-bit numbers in base64, with the scale of each column."""

import base64
from typing import Any

import numpy as np
from jaxtyping import Float, Int

NOT_A_NUMBER = -32768
"""Code of NaN."""
LARGEST = 32767


def packed(values: Float[np.ndarray, "n *k"]) -> dict[str, Any]:
    """Return an array as JSON values: each column in 65,535 equal steps between its smallest and its largest value.

    The rounding error is at most one part in 131,068 of the column's range: 0.04 mm on a stair of 5 m.
    """
    table = np.asarray(values, dtype=float).reshape(len(values), -1)
    known = np.isfinite(table)
    low = np.where(known, table, np.inf).min(axis=0, initial=np.inf)
    high = np.where(known, table, -np.inf).max(axis=0, initial=-np.inf)
    low, high = np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)
    step = np.where(high > low, (high - low) / (2 * LARGEST), 1.0)
    codes = np.round((np.where(known, table, low) - low) / step) - LARGEST
    codes = np.where(known, codes, NOT_A_NUMBER).astype("<i2")
    return {"data": _text(codes), "columns": table.shape[1], "low": low.tolist(), "step": step.tolist()}


def unpacked(value: dict[str, Any]) -> Float[np.ndarray, "n k"]:
    """Return the array of ``packed``."""
    codes = np.frombuffer(base64.b64decode(value["data"]), "<i2").reshape(-1, value["columns"]).astype(float)
    table = np.array(value["low"]) + np.array(value["step"]) * (codes + LARGEST)
    return np.where(codes == NOT_A_NUMBER, np.nan, table)


def packed_indices(indices: Int[np.ndarray, "*n"]) -> str:
    """Return non-negative integers below 65,536 as base64.

    Raises:
        ValueError: If an index is larger.
    """
    if indices.size and not 0 <= int(indices.min()) <= int(indices.max()) < 1 << 16:
        raise ValueError(f"an index of {int(indices.max())} in 16 bits; split the mesh")
    return _text(indices.astype("<u2"))


def _text(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
