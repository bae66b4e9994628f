"""Ticks of the guard process while two real-time processes keep both cores busy, and every device is a pseudo-terminal."""

import json
import subprocess
import sys

import pytest
from firmware_memory import HAS_COMPILER

from treadline.core.processes import GUARD, real_time

pytest.importorskip("serial", reason="pyserial is not installed: pip install 'treadline[hardware]'")
if not HAS_COMPILER:
    pytest.skip("no C compiler (cc, gcc or clang) on the path", allow_module_level=True)


def test_no_tick_waits_for_a_device() -> None:
    """Test: bursts of 0.2 s, in which no kernel worker of ordinary priority runs. Expected result: no tick takes 10 ms, a period;
    when a tick begins is the matter of the machine, which may itself be paused."""
    with real_time(GUARD) as granted:
        pass
    if "SCHED_FIFO" not in granted:
        pytest.skip(granted)
    done = subprocess.run([sys.executable, "-m", "bursts"], check=True, stdout=subprocess.PIPE, timeout=120.0)
    ticks = json.loads(done.stdout)
    assert ticks["lost"] is None
    assert ticks["box"]  # states of the box arrived
    assert max(ticks["took"]) <= 10e-3
