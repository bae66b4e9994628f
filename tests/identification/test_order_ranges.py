"""An order among several: the best of a range by the criterion of the method."""

import pytest
from systems import Draw, fit

from treadline.core.errors import SettingsError, TooFewSamples
from treadline.identification import IdentificationOptions

METHODS = ["okid-era", "pbsid", "best"]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("orders", [range(3, 6), [4, 3], [3], 3], ids=str)
def test_the_order_is_one_of_those_allowed(draw: Draw, method: str, orders: range | list[int] | int) -> None:
    found = fit(draw(1, samples=400, noise=0.05), method=method, order=orders)
    assert found.report.order == found.model.order
    assert found.model.order in ([orders] if isinstance(orders, int) else orders)


@pytest.mark.parametrize("method", ["okid-era", "pbsid"])
def test_a_range_around_the_true_order_finds_it(draw: Draw, method: str) -> None:
    record = draw(2, samples=1000, noise=0.02)
    assert fit(record, method=method, order=range(1, 7)).model.order == 2


def test_orders_beyond_the_data_and_empty_ranges_are_refused(draw: Draw) -> None:
    with pytest.raises(TooFewSamples, match="order 31 with 16 lags need at least 552"):
        fit(draw(4, samples=100, noise=0.1), method="okid-era", order=range(30, 32))
    with pytest.raises(SettingsError, match=r"order is empty; .* range\(2, 9\)"):
        IdentificationOptions(order=range(9, 2))
    with pytest.raises(SettingsError, match="order is 0; it must be an integer, at least 1"):
        IdentificationOptions(order=range(3))
