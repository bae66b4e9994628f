"""Campaigns: many simulated traversals sampled from stated distributions, run on many processes, and summarised.

Contract: ``spec.read_spec`` reads what is sampled, ``sweep.SweepPlan`` and ``sweep.run_sweep`` execute it with ``sweep.Pool`` or
``sweep.Cluster``. The function that simulates a run is passed in; this package has no simulator.
"""
