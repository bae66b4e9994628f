"""Heading control: from a linear model to belt speeds that keep the chair aligned with the stair."""

from treadline.control.heading_controller import ControllerConfig, HeadingController
from treadline.control.lqr import closed_loop_poles, lqr_gain
from treadline.control.tune import tune

__all__ = ["ControllerConfig", "HeadingController", "closed_loop_poles", "lqr_gain", "tune"]
