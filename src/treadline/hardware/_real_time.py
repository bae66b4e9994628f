"""Real-time scheduling of the guard process and of the loop, where the system allows it."""

import os
from collections.abc import Iterator
from contextlib import contextmanager

GUARD, LOOP = 2, 1
"""Priorities: the least two of the system's, so that both run before every process without one, and the guard before the loop."""


@contextmanager
def real_time(priority: int) -> Iterator[str]:
    """Run with real-time scheduling; yield what was granted, as words for the log."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError) as error:
        reason = getattr(error, "strerror", None) or "not of this system"
        yield f"no real-time scheduling ({reason}): allow it by 'rtprio {GUARD}' in /etc/security/limits.conf, or CAP_SYS_NICE"
        return
    try:
        yield f"real-time scheduling, SCHED_FIFO {priority}"
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
