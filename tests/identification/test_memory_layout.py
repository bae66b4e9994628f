"""Memory layout: kernels are compiled for one layout, so that ``treadline compile`` compiles them once for every record."""

import numpy as np
import pytest
from systems import fit

from treadline.core.models import InputOutputRecord


@pytest.mark.parametrize("kind", ["column-major", "read-only", "single precision", "cut"])
def test_a_record_holds_one_layout_and_the_model_does_not_depend_on_the_given_one(kind: str) -> None:
    rng = np.random.default_rng(1)
    u = np.round(rng.normal(size=(200, 2)), 3).astype(np.float32).astype(float)
    y = np.round(np.cumsum(u, axis=0) * 0.1, 3).astype(np.float32).astype(float)
    wide = np.hstack([u, y])
    wide.setflags(write=False)
    given = {
        "column-major": np.asfortranarray(u),
        "read-only": wide[:, :2].copy(),
        "single precision": u.astype(np.float32),
        "cut": wide[:, :2],
    }[kind]
    if kind == "read-only":
        given.setflags(write=False)
    record = InputOutputRecord(u=given, y=y, dt_s=1.0)
    assert record.u.flags.c_contiguous
    assert record.u.flags.writeable
    assert record.u.dtype == np.float64
    # The values are equal in single precision, so the models are equal to the last bit.
    plain = fit(InputOutputRecord(u=u, y=y, dt_s=1.0), order=2, method="okid-era").model
    np.testing.assert_array_equal(fit(record, order=2, method="okid-era").model.A, plain.A)
