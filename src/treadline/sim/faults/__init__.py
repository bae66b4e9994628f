"""Injection of faults of sensors, commands and the chair itself into a simulated chair."""

from treadline.sim.faults.damage import Damage
from treadline.sim.faults.plant import FaultyPlant, faulty

__all__ = ["Damage", "FaultyPlant", "faulty"]
