"""One signal of each kind that nodes exchange, with the channel on which it travels."""

import numpy as np
from world import stair

from treadline.core.camera_images import PinholeCamera, RgbdFrame
from treadline.core.signals import (
    Event,
    FlipperCommand,
    FlipperReading,
    FrameQuality,
    FreeGround,
    HeadingEstimate,
    HeadingHealth,
    HeadingMeasurement,
    ImuSample,
    MotionPlan,
    OperatorInput,
    PlantState,
    SeatCommand,
    SeatReading,
    TrackCommand,
    TrackReading,
    VelocityCommand,
)
from treadline.mission.odometry import Odometry
from treadline.ros import channels as on

T_S = 12.34
CAMERA = PinholeCamera(
    width_px=8, height_px=6, fx_px=7.0, fy_px=7.5, cx_px=3.5, cy_px=2.5, mount_pitch_rad=0.4, mount_m=(0.1, 0.0, 0.9)
)
DEPTH = np.linspace(0.5, 3.0, 48, dtype=np.float32).reshape(6, 8)
DEPTH[2, 3] = np.nan
PLACES_B = [(-0.1, 0.0, 0.01), (-0.4, 0.001, -0.17)]
SIDES_M = {"right_wall_m": 0.6, "left_seen_m": -0.1, "right_seen_m": 0.55, "turn_rad": 0.52}
MAP = stair(T_S, PLACES_B, direction="down", rise_m=0.17, slope_rad=0.5, ends=True, **SIDES_M)
SIGNALS = [
    (on.CLOCK, on.Clock(t_s=T_S)),
    (on.TWIST, VelocityCommand(t_s=T_S, speed_m_s=0.2, turn_rad_s=-0.1)),
    (
        on.ODOM,
        Odometry(
            t_s=T_S,
            p_OB=np.array([1.0, -2.0, 0.5]),
            orientation=np.array([0.8, 0.0, -0.6, 0.0]),
            speed_m_s=0.2,
            angular_velocity_rad_s=np.array([0.1, 0.2, 0.3]),
        ),
    ),
    (
        on.IMU,
        ImuSample(
            t_s=T_S,
            orientation=np.array([0.9, 0.1, 0.2, 0.3]),
            angular_velocity_rad_s=np.array([0.1, np.nan, 3.0]),
            linear_acceleration_m_s2=np.array([1.0, 2.0, 9.8]),
        ),
    ),
    (on.TRACKS, TrackReading(t_s=T_S, left_m_s=0.1, right_m_s=-0.2, brake_on=True)),
    (on.SEAT, SeatReading(t_s=T_S, pitch_rad=0.1, stroke_m=0.2)),
    (on.FLIPPER, FlipperReading(t_s=T_S, angle_rad=0.3, torque_n_m=-40.0)),
    (on.OPERATOR, OperatorInput(t_s=T_S, dead_man=True, stop=False, rearm=True, go_back=True)),
    (on.GROUND, FreeGround(t_s=T_S, view="front", blind_m=0.8, seen_m=2.0, end_m=1.9, end_sigma_m=0.02)),
    (on.PLANT, PlantState(t_s=T_S, fault=None)),
    (on.PLANT, PlantState(t_s=T_S, fault="no command for 0.31 s")),
    (on.CAMERA, RgbdFrame(t_s=T_S, rgb=np.arange(144, dtype=np.uint8).reshape(6, 8, 3), depth_m=DEPTH, camera=CAMERA)),
    (on.CAMERA_HEADING, HeadingMeasurement(t_s=T_S, heading_rad=0.1, sigma_rad=0.01, edge_count=4)),
    (on.CAMERA_MAP, MAP),
    (on.CAMERA_QUALITY, FrameQuality(t_s=T_S, fingerprint=4294967295, brightness=0.5, contrast=0.1, valid_share=0.9)),
    (on.QUALITY, FrameQuality(t_s=T_S, fingerprint=1, brightness=0.5, contrast=0.1, valid_share=0.9)),
    (on.QUALITY, FrameQuality(t_s=T_S, fingerprint=1, brightness=0.5, contrast=0.1, valid_share=0.9, obstacle_m=1.25)),
    (on.MEASURED, HeadingMeasurement(t_s=T_S, heading_rad=-0.1, sigma_rad=0.02, edge_count=5, correction_rad=0.03)),
    (on.MAP, MAP),
    (on.ESTIMATE, HeadingEstimate(t_s=T_S, heading_rad=0.1, heading_rate_rad_s=0.2, sigma_rad=0.3, source="gyro")),
    (
        on.HEALTH,
        HeadingHealth(
            t_s=T_S,
            fault="jump",
            since_s=1.25,
            cause="by 5°",
            disagreement_rad=0.1,
            unseen_s=0.2,
            bias_rad_s=1e-3,
            scale=1.01,
            walk_rad_rts=1e-4,
        ),
    ),
    (on.PLAN, MotionPlan(t_s=T_S, phase="climb", speed_m_s=0.2, cause="traction tried")),
    (
        on.PLAN,
        MotionPlan(
            t_s=T_S,
            phase="crest",
            speed_m_s=-0.1,
            turn_m_s=0.05,
            heading_rad=0.1,
            pitch_feedforward_m_s=-0.1 + 0.003,
            flipper=FlipperCommand(t_s=T_S, rate_rad_s=0.1 + 0.2),
            needs_stair=False,
            cause="Kuppe",
            hold="knows no further",
        ),
    ),
    (on.TRACKS_PROPOSED, TrackCommand(t_s=T_S, left_m_s=0.1, right_m_s=0.2)),
    (on.TRACKS_CMD, TrackCommand(t_s=T_S, left_m_s=0.0, right_m_s=0.0, brake=True, sender="guard-1")),
    (on.SEAT_PROPOSED, SeatCommand(t_s=T_S, rate_m_s=0.01)),
    (on.SEAT_CMD, SeatCommand(t_s=T_S, rate_m_s=-0.01)),
    (on.FLIPPER_CMD, FlipperCommand(t_s=T_S, rate_rad_s=0.3)),
    (on.GUARD, on.GuardState(t_s=T_S, holding=None)),
    (on.GUARD, on.GuardState(t_s=T_S, holding="slip 0.40", sender="guard-1")),
    (on.DIAGNOSTICS, on.Beat(t_s=T_S, node="camera")),
    (on.DIAGNOSTICS, Event(t_s=T_S, name="hold", cause="slip 0.40")),
]
