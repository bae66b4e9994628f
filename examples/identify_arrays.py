"""Identify a linear model from arrays, save it, load it and design its controller.

The data are simulated here: yaw of a tracked chair with a lag of 0.4 s, inputs are its belt speeds.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import treadline as tl

dt, samples, gauge_m, lag_s = 0.25, 800, 0.64, 0.4
rng = np.random.default_rng(1)
u = 0.2 + 0.05 * rng.standard_normal((samples, 2))  # left and right belt [m/s]
y = np.zeros((samples, 2))  # heading [rad], yaw rate [rad/s]
for k in range(samples - 1):
    target = 0.5 * (u[k, 1] - u[k, 0]) / gauge_m
    y[k + 1, 1] = target + (y[k, 1] - target) * np.exp(-dt / lag_s)
    y[k + 1, 0] = y[k, 0] + dt * y[k, 1]
noisy = y + rng.normal(0.0, (0.002, 0.005), y.shape)

found = tl.identify(u, noisy, dt, order=2, method="okid-era", validation=0.3)
print(found)
with TemporaryDirectory() as folder:
    path = Path(folder, "model.json")
    found.model.save(path)
    model = tl.load_model(path)
print(model)
print(tl.tune(model))
