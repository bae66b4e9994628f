"""Types of the keywords of ``treadline.identify``, for type checkers and editors; nothing imports them at run time."""

from collections.abc import Sequence
from typing import TypedDict

from treadline.core.models import InputOutputRecord
from treadline.identification.gram import Gram


class IdentificationKeywords(TypedDict, total=False):
    """The fields of ``IdentificationOptions`` as keywords of ``treadline.identify``."""

    order: int | None
    lags: int | None
    method: str | None
    feedthrough: bool | None
    delays: Sequence[int] | str | None
    solver: str
    stable: bool
    validation: float | InputOutputRecord | None
    prior: Gram | None
    forgetting: float
