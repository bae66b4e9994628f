"""What a verb answers with, and how it is said."""

import errno
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from treadline.core.plain_values import plain


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """A verb's result: JSON values, a summary for people, and an exit code."""

    values: Mapping[str, Any]
    summary: Sequence[str]
    code: int = 0
    """0: done; 1: the job ran and the answer is no."""


def say(answer: Answer, *, as_json: bool) -> None:
    """Write an answer to stdout.

    Raises:
        OSError: If stdout takes it not, or is closed.
    """
    if sys.stdout is None:
        raise OSError(errno.EBADF, "it is closed")
    text = json.dumps(plain(answer.values), allow_nan=False) if as_json else "\n".join(answer.summary)
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
