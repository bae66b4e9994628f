"""Identification in single steps: ``okid`` followed by ``era``; or ``pbsid``.

>>> observer = okid(record, lags=20)
>>> A, B, C, D = era(system_markov(observer, 41), order=2)
"""

from collections.abc import Sequence

from treadline.core.errors import PoorExcitation
from treadline.core.models import InputOutputRecord, LinearModel
from treadline.identification._affine import to_model
from treadline.identification._checks import channel_names, check_integers, check_records
from treadline.identification._pbsid import pbsid as realised_by_pbsid
from treadline.identification._pbsid import state_map
from treadline.identification._threads import one_thread
from treadline.identification.gram import Gram, gram_of
from treadline.identification.okid import ObserverMarkov, observer_markov
from treadline.identification.windows import max_supported_lags


@one_thread()
def okid(
    records: InputOutputRecord | Sequence[InputOutputRecord], *, lags: int, feedthrough: bool = True, solver: str = "gram"
) -> ObserverMarkov:
    """Return the observer's Markov parameters for one or more experiments by least squares.

    Paper: Eq. (9a), (9b).

    Raises:
        RecordError: If the data do not support as many lags.
        SettingsError: If lags is not an integer, at least 1.
    """
    return observer_markov(_sums(records, lags, None, solver), feedthrough=feedthrough)


@one_thread()
def pbsid(
    records: InputOutputRecord | Sequence[InputOutputRecord],
    *,
    order: int,
    lags: int = 10,
    feedthrough: bool = True,
    solver: str = "gram",
) -> LinearModel:
    """Return the model of an order by PBSID_opt (Chiuso, 2007).

    Raises:
        RecordError: If the data do not support as many lags or states.
        SettingsError: If order or lags is not an integer, at least 1.
    """
    data = _sums(records, lags, order, solver)
    states = state_map(data, lags, feedthrough=feedthrough)
    if order > len(states.s):
        raise PoorExcitation(f"order {order} is above the rank {len(states.s)} that {lags} lags show; ask for less")
    found = realised_by_pbsid(data, states, order, lags, feedthrough=feedthrough)
    first = records if isinstance(records, InputOutputRecord) else records[0]
    return to_model(found, data.units, data.dt_s, channel_names(first))


def _sums(records: InputOutputRecord | Sequence[InputOutputRecord], lags: int, order: int | None, solver: str) -> Gram:
    check_integers(order=order, lags=lags)
    given = [records] if isinstance(records, InputOutputRecord) else list(records)
    units = check_records(given)
    return gram_of(given, max_supported_lags(given, lags, order), units, solver=solver)
