"""The Gram matrix of windows equals the dense computation for any division of the data, and can be saved."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float
from systems import noise_record

from treadline.core.errors import LogFormatError, ShapeMismatch, TreadlineError
from treadline.core.models import InputOutputRecord
from treadline.identification import Gram, gram_of
from treadline.identification._gram import GramBuilder, Units, units_of

ROUNDING = 1e-11
"""Absolute tolerance: sums of a few hundred products of size ten, each accurate to 1e-16, slid along the diagonal; 1e-13 was
measured."""


Case = tuple[int, int, int, int, list[int]]
CASES = st.tuples(
    st.integers(0, 2**32 - 1), st.integers(1, 3), st.integers(1, 3), st.integers(1, 160), st.lists(st.integers(0, 159), max_size=4)
)
"""Seed, inputs, outputs, samples, and the positions of gaps."""


def record_of(case: Case) -> InputOutputRecord:
    seed, m, p, samples, gaps = case
    rng = np.random.default_rng(seed)
    u, y = rng.standard_normal((samples, m)), 5.0 + rng.standard_normal((samples, p))
    for at in gaps:
        (u if at % 2 else y)[at % samples, 0] = np.nan
    return InputOutputRecord(u=u, y=y, dt_s=0.1)


def some_units(record: InputOutputRecord) -> Units:
    r = record.u.shape[1] + record.y.shape[1]
    return Units(shift=np.linspace(-1.0, 1.0, r), scale=np.linspace(0.5, 2.0, r), input_count=record.u.shape[1])


def whole_windows(record: InputOutputRecord, lags: int, units: Units) -> Float[np.ndarray, "rows q"]:
    """Return every complete window of a record, one row each."""
    z = (np.hstack([record.u, record.y]) - units.shift) / units.scale
    rows = [np.concatenate([[1.0], z[k - lags : k + 1][::-1].ravel()]) for k in range(lags, len(z))]
    X = np.array(rows).reshape(len(rows), 1 + z.shape[1] * (lags + 1))
    return X[np.isfinite(X).all(axis=1)]


def random_record(seed: int, samples: int = 400) -> InputOutputRecord:
    return noise_record(seed, samples, outputs=1, dt_s=0.1)


@settings(max_examples=60)
@given(CASES, st.integers(1, 7))
def test_the_gram_matrix_equals_the_sum_over_all_complete_windows(case: Case, lags: int) -> None:
    record = record_of(case)
    units = some_units(record)
    X = whole_windows(record, lags, units)
    found = gram_of([record], lags, units)
    np.testing.assert_allclose(found.sums, X.T @ X, atol=ROUNDING, rtol=ROUNDING)
    assert found.count == len(X)
    assert found.dropped == max(len(record) - lags, 0) - len(X)


@settings(max_examples=40)
@given(CASES, st.integers(1, 7), st.lists(st.integers(0, 160), max_size=5))
def test_any_cut_into_chunks_gives_the_same_sums(case: Case, lags: int, cuts: list[int]) -> None:
    record = record_of(case)
    units = some_units(record)
    at_once = gram_of([record], lags, units)
    builder = GramBuilder(lags, units, record.dt_s)
    for piece in np.split(np.arange(len(record)), sorted(min(cut, len(record)) for cut in cuts)):
        builder.add(record.u[piece], record.y[piece])
    found = builder.finish()
    np.testing.assert_allclose(found.sums, at_once.sums, atol=ROUNDING, rtol=ROUNDING)
    assert (found.count, found.dropped) == (at_once.count, at_once.dropped)


@settings(max_examples=20)
@given(CASES, st.integers(1, 7))
def test_the_triangular_root_has_the_sums_as_its_square(case: Case, lags: int) -> None:
    record = record_of(case)
    units = some_units(record)
    found, plain = gram_of([record], lags, units, solver="qr"), gram_of([record], lags, units)
    np.testing.assert_allclose(found.root.T @ found.root, plain.sums, atol=ROUNDING, rtol=ROUNDING)
    assert (found.count, found.dropped) == (plain.count, plain.dropped)


def test_sums_of_fewer_lags_are_the_leading_block() -> None:
    record = random_record(4)
    units = some_units(record)
    data = gram_of([record], 8, units, solver="qr")
    fewer = data.fewer(3)
    assert (fewer.lags, fewer.sums.shape) == (3, (1 + 3 * 4, 1 + 3 * 4))
    np.testing.assert_array_equal(fewer.sums, data.sums[:13, :13])
    # The same windows without their older samples: those of three lags that end at the ninth sample or later.
    later = InputOutputRecord(u=record.u[5:], y=record.y[5:], dt_s=0.1)
    np.testing.assert_allclose(fewer.sums, gram_of([later], 3, units).sums, atol=ROUNDING)
    np.testing.assert_allclose(fewer.root.T @ fewer.root, fewer.sums, atol=ROUNDING)


def test_sums_of_other_lags_units_or_periods_do_not_add_up() -> None:
    record = random_record(7)
    units = some_units(record)
    data = gram_of([record], 4, units)
    with pytest.raises(ShapeMismatch, match="of 4 and 5 lags do not add up"):
        data + gram_of([record], 5, units)
    for other in (gram_of([record], 4, units_of([record])), replace(data, dt_s=0.2)):
        with pytest.raises(ShapeMismatch):
            data + other


def test_units_are_mean_and_deviation_without_the_gaps() -> None:
    first, second = random_record(9), random_record(10, 100)
    first.u[3, 0] = first.y[:50, 0] = np.nan
    joined = np.vstack([np.hstack([item.u, item.y]) for item in (first, second)])
    units = units_of([first, second])
    np.testing.assert_allclose(units.shift, np.nanmean(joined, axis=0), atol=1e-14)
    np.testing.assert_allclose(units.scale, np.nanstd(joined, axis=0), rtol=1e-13)


def test_an_offset_does_not_reduce_the_precision_of_the_deviation() -> None:
    record = random_record(11)
    far = InputOutputRecord(u=record.u + 1e8, y=record.y - 1e8, dt_s=0.1)
    # A sample of 1e8 is accurate to 1e-8, and so is a deviation of one; squares about zero would lose all digits.
    np.testing.assert_allclose(units_of([far]).scale, units_of([record]).scale, rtol=1e-8)


def saved(folder: Path, **changes: object) -> Path:
    """Return a file with a Gram matrix, some parts changed; None removes a part."""
    record = random_record(12, 60)
    gram_of([record], 2, some_units(record)).save(folder / "sums.npz")
    with np.load(folder / "sums.npz") as file:
        parts = {**file, **changes}
    np.savez(folder / "changed.npz", **{name: np.asarray(value) for name, value in parts.items() if value is not None})
    return folder / "changed.npz"


def test_saved_sums_come_back_bit_by_bit(tmp_path: Path) -> None:
    record = random_record(13)
    record.y[7] = np.nan
    data = gram_of([record], 5, some_units(record)).forgotten(0.9)
    data.save(tmp_path / "new" / "sums.npz")
    again = Gram.load(tmp_path / "new" / "sums.npz")
    for found, held in ((again.sums, data.sums), (again.units.shift, data.units.shift), (again.units.scale, data.units.scale)):
        np.testing.assert_array_equal(found, held)
    assert (again.lags, again.dt_s, again.count, again.dropped) == (data.lags, data.dt_s, data.count, data.dropped)
    assert again.units.input_count == 2
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["sums.npz"]


def test_a_file_that_lacks_a_part_is_rejected(tmp_path: Path) -> None:
    for missing in ("lags", "dt_s", "sums", "count", "dropped", "shift", "scale", "input_count"):
        with pytest.raises(LogFormatError, match=f"not a saved Gram matrix: .*{missing}"):
            Gram.load(saved(tmp_path, **{missing: None}))


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("lags", 3),
        ("lags", [1, 2]),
        ("sums", np.eye(4)),
        ("sums", np.full((10, 10), np.nan)),
        ("sums", np.array([{}], dtype=object)),
        ("sums", np.triu(np.ones((10, 10)))),
        ("scale", [1.0, np.nan, 1.0]),
        ("scale", [1.0, 0.0, 1.0]),
        ("shift", [0.0, 0.0]),
        ("count", np.nan),
        ("dt_s", 0.0),
        ("input_count", 9),
    ],
)
def test_a_part_that_does_not_fit_the_others_is_rejected(tmp_path: Path, part: str, value: object) -> None:
    with pytest.raises(LogFormatError, match=r"changed\.npz: "):
        Gram.load(saved(tmp_path, **{part: value}))


def test_a_file_of_another_kind_is_rejected(tmp_path: Path) -> None:
    (tmp_path / "empty.npz").touch()
    whole = saved(tmp_path).read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    flipped = bytearray(whole)
    with np.load(tmp_path / "changed.npz") as file:
        flipped[whole.index(file["sums"].tobytes()) + 20] ^= 1
    (tmp_path / "flipped.npz").write_bytes(flipped)
    (tmp_path / "text.npz").write_text("t,u,y\n0,1,2\n")
    np.save(tmp_path / "array.npy", np.eye(3))
    for name in ("empty.npz", "half.npz", "flipped.npz", "text.npz", "array.npy"):
        with pytest.raises(LogFormatError, match=f"{name}: not a saved Gram matrix"):
            Gram.load(tmp_path / name)
    with pytest.raises(LogFormatError, match="no such file"):
        Gram.load(tmp_path / "none.npz")
    with pytest.raises(LogFormatError, match="not a saved Gram matrix"):
        Gram.load(tmp_path)


def test_a_failed_write_names_the_file(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(TreadlineError, match=r"sums\.npz: cannot be written"):
        gram_of([random_record(14)], 1, some_units(random_record(14))).save(tmp_path / "file" / "sums.npz")
