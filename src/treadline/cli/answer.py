"""What a verb answers with, and how it is said."""

import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from treadline.io.plain import plain


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """A verb's result: JSON values, a summary for people, and an exit code."""

    values: Mapping[str, Any]
    summary: Sequence[str]
    code: int = 0
    """0: done; 1: the job ran and the answer is no."""


def say(answer: Answer, *, as_json: bool) -> None:
    """Write an answer to stdout."""
    if as_json:
        sys.stdout.write(json.dumps(plain(answer.values), allow_nan=False) + "\n")
    else:
        sys.stdout.write("\n".join(answer.summary) + "\n")
