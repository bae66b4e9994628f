"""What one run was, in a line: the verb, what it was done to, and how it ended."""

import shlex
from itertools import pairwise

from treadline.report.results import Manifest, RunResult

FLAGS = {"--json", "--quick", "--log-images", "--debug"}
"""Options that no value follows."""


def headline(result: RunResult, manifest: Manifest, name: str) -> str:
    """Return the heading of a run's page, as in ``climb up-28: arrived after 48.8 s``.

    Args:
        name: Name of the run folder, which identifies a run of a reproduction.
    """
    verb, subject = _asked(manifest.command)
    if verb == "reproduce":
        subject = name
    cause = f" ({result.cause})" if result.cause else ""
    return f"{' '.join(word for word in (verb, subject) if word) or 'One run'}: {_ending(verb, result)}{cause}"


def _asked(command: str) -> tuple[str, str]:
    """Return verb and subject of a command line, empty where it names none."""
    try:
        words = shlex.split(command)
    except ValueError:
        return "", ""
    if words[:1] != ["treadline"] or len(words) < 2:
        return "", ""
    plain = [word for before, word in pairwise(words[1:]) if not word.startswith("-") and not _takes_next(before)]
    return words[1], plain[0] if plain else ""


def _takes_next(word: str) -> bool:
    return word.startswith("--") and "=" not in word and word not in FLAGS


def _ending(verb: str, result: RunResult) -> str:
    if result.seat is not None:
        settle = result.seat.settle_s
        return "the seat did not settle" if settle is None else f"level within 1° after {settle:.2f} s"
    duration = result.figures.get("duration_s")
    if result.verdict == "time_up":
        whole = "played to its end" if verb == "replay" else "driven to the end of its time"
        return whole if duration is None else f"{whole}, {duration:.1f} s"
    ended = {"diverged": "the simulation diverged"}.get(result.verdict, result.verdict)
    return ended if duration is None or result.verdict == "refused" else f"{ended} after {duration:.1f} s"
