"""The first run on a machine: nothing is compiled yet, and the graph must run all the same."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

RENDERED = """
from treadline.core.kernel_cache import compiling
from treadline.ros import channels as on
from treadline.ros.assembly import node_of
from treadline.ros.lockstep import InProcess
from treadline.run.resolve import resolve
from treadline.core.camera_images import RgbdFrame
from treadline.core.signals import ImuSample
from treadline.plant.mujoco import open_plant

clock = compiling()
setup = resolve("{scenario}")
node, bus = node_of("camera", setup.mission), InProcess()
node.listen(bus)
seen = []
bus.subscribe(on.MEASURED, seen.append)
plant = open_plant(setup.scenario, 0)
plant.start()
warmed_s, spent_s = clock.spent_s, 0.0
for tick in range(60):
    plant.advance(0.01 * tick)
    node.tick(0.01 * tick)
    for reading in plant.read():
        channel = on.CAMERA if isinstance(reading, RgbdFrame) else on.IMU if isinstance(reading, ImuSample) else None
        if channel is not None:
            before_s = clock.spent_s
            bus.publish(channel, reading)
            spent_s += clock.spent_s - before_s
print(warmed_s, spent_s, len(seen))
"""


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["flight-20", "down-28"])
def test_the_warm_up_compiles_all_that_rendered_frames_need(tmp_path: Path, scenario: str) -> None:
    """Test: an empty cache, then frames rendered on the flight, up and down. Expected result: headings, and nothing compiled."""
    command, env = [sys.executable, "-c", RENDERED.format(scenario=scenario)], os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    warmed_s, spent_s, seen = map(float, done.stdout.split())
    assert warmed_s > 5.0  # the cache was empty: about 28 s are usual
    assert seen >= 3
    # One kernel takes half a second and more.
    assert spent_s < 0.1
