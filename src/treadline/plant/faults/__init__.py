"""Injection of faults of sensors, commands and the chair itself into a simulated chair."""

from treadline.plant.faults._damage import Damage
from treadline.plant.faults._faulty_plant import FaultyPlant, faulty

__all__ = ["Damage", "FaultyPlant", "faulty"]
