"""Batch rate of the plant: ``python benchmarks/batch.py [--threads N] [--plants N] [--warp]``.

Steps many chairs at once on a 28° flight, one thread per core; the compiled loop releases the interpreter lock. The reference is
``mujoco.rollout`` on the same scene, with MuJoCo's own uncorrected step. ``--warp`` also runs the scene exported by
``treadline model SCENARIO --to mjcf``, unchanged, on mujoco-warp (``pip install mujoco-warp``). It uses a GPU if present and the
CPU otherwise; the speed on the CPU is not representative. The state after 100 steps is compared with MuJoCo's.
"""

import argparse
import math
import os
import statistics
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

from treadline.core.angles import DEG
from treadline.core.signals import SeatCommand, TrackCommand
from treadline.plant.mujoco import MujocoPlant, Physics, model_xml, open_plant
from treadline.scenario.chair import read_chair
from treadline.scenario.scenario import Chair, Control, Scenario, Stair, Start, read_scenario
from treadline.vehicle.staircase import build_staircase

SPAN_S = 2.0
REPEATS = 5
SCENARIO = Scenario(
    stair=Stair(rise_m=0.30 * math.tan(28.0 * DEG), steps=60, width_m=10.0, walls="none"),
    chair=Chair(belt_mismatch=0.02),
    start=Start(place="flight", step=6),
    control=Control(vision="truth"),
)


def climbing(seed: int) -> MujocoPlant:
    """Return a started plant that climbs at 0.2 m/s."""
    plant = open_plant(SCENARIO, seed)
    plant.start()
    plant.write(TrackCommand(t_s=0.0, left_m_s=0.2, right_m_s=0.2), SeatCommand(t_s=0.0, rate_m_s=0.0))
    return plant


def plant_rate(plants: list[MujocoPlant], threads: int) -> list[float]:
    """Return steps per second of wall clock over all plants, once per repeat."""
    rates, until_s = [], 0.0
    with ThreadPoolExecutor(threads) as pool:
        for _ in range(REPEATS):
            until_s += SPAN_S
            started = time.perf_counter()
            list(pool.map(lambda plant, t_s=until_s: plant.advance(t_s), plants))
            rates.append(len(plants) * SPAN_S / Physics().timestep_s / (time.perf_counter() - started))
    return rates


def rollout_rate(plants: list[MujocoPlant], threads: int) -> list[float]:
    """Return the same of ``mujoco.rollout``, MuJoCo's own step."""
    steps, kind = round(SPAN_S / Physics().timestep_s), mujoco.mjtState.mjSTATE_FULLPHYSICS
    models = [plant._model for plant in plants]  # noqa: SLF001 - the peer runs on the plant's own scene
    states = np.empty((len(plants), mujoco.mj_stateSize(models[0], kind)))
    for state, plant in zip(states, plants, strict=True):
        mujoco.mj_getState(plant._model, plant._data, state, kind)  # noqa: SLF001 - as above
    data = [mujoco.MjData(models[0]) for _ in range(threads)]
    rates = []
    with rollout.Rollout(nthread=threads) as pool:
        for _ in range(REPEATS):
            started = time.perf_counter()
            pool.rollout(models, data, states, nstep=steps)
            rates.append(len(plants) * steps / (time.perf_counter() - started))
    return rates


def on_warp() -> str:
    """Return how the exported scene runs on mujoco-warp."""
    try:
        import mujoco_warp
        import warp
    except ImportError:
        return "mujoco-warp is not installed: pip install mujoco-warp"
    scenario = read_scenario("up-28")
    chair = read_chair(scenario.chair.model)
    staircase = build_staircase(scenario.stair, np.random.default_rng(0))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.xml"
        path.write_text(model_xml(staircase, chair, scenario.chair, friction=staircase.friction[0]), encoding="utf-8")
        model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    on_device = mujoco_warp.put_model(model)
    worlds = mujoco_warp.put_data(model, data, nworld=16, nconmax=64, njmax=256)
    mujoco_warp.step(on_device, worlds)
    warp.synchronize()
    started = time.perf_counter()
    for _ in range(100):
        mujoco_warp.step(on_device, worlds)
    warp.synchronize()
    rate = 16 * 100 / (time.perf_counter() - started)
    for _ in range(101):
        mujoco.mj_step(model, data)
    gap_m = float(np.abs(worlds.qpos.numpy()[0, :3] - data.qpos[:3]).max())
    return f"{warp.get_device()}: {rate:.0f} steps/s of 16 worlds; place after 0.2 s {gap_m * 1000.0:.3f} mm from MuJoCo's"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--plants", type=int, default=8)
    parser.add_argument("--warp", action="store_true")
    options = parser.parse_args()
    plants = [climbing(seed) for seed in range(options.plants)]
    plants[0].advance(0.1)  # compiles, or loads what was compiled
    print(f"{options.plants} chairs on 28°, {options.threads} threads, MuJoCo {mujoco.__version__}")
    print(f"steps/s of wall clock, median of {REPEATS}")
    ours, alone = plant_rate(plants, options.threads), plant_rate([climbing(0)], 1)
    peer = rollout_rate(plants, options.threads)
    for name, rates in (
        ("corrected contact, drives and log", ours),
        ("the same, one chair, one thread", alone),
        ("mujoco.rollout", peer),
    ):
        rate = statistics.median(rates)
        print(f"  {name:36s} {rate:9.0f}  ({min(rates):.0f} to {max(rates):.0f}), {rate * Physics().timestep_s:.0f} x real time")
    print(f"  ratio to mujoco.rollout {statistics.median(ours) / statistics.median(peer):.2f}")
    if options.warp:
        print(f"  mujoco-warp, exported scene: {on_warp()}")


if __name__ == "__main__":
    main()
