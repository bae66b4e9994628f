"""Nuisance parameters of stair and camera: irregularity of the steps and warp of the depth."""
