"""Faults of sensors, orders and the chair itself, injected around a simulated chair."""

from treadline.sim.faults.damage import Damage
from treadline.sim.faults.plant import FaultyPlant, faulty

__all__ = ["Damage", "FaultyPlant", "faulty"]
