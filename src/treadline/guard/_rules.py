"""All rules of the guard, in the order in which the first cause counts.

The guard, its re-arm, the page of hazards (``docs/tools/hazards.py``) and the tests loop over ``RULES``.
"""

from treadline.guard._attitude_limits import SeatMonitor, TiltMonitor
from treadline.guard._belt_monitor import BeltMonitor
from treadline.guard._drop_monitor import DropMonitor
from treadline.guard._gyro_only_turn import GyroOnlyTurn, TurnedOver
from treadline.guard._known import Monitor
from treadline.guard._obstacle_monitor import AheadMonitor
from treadline.guard._pace import BatteryMonitor, Pace, PlantFault
from treadline.guard._sensor_timeouts import BothSenses, FilterHealth, Senses
from treadline.guard._silence import (
    DriveSilence,
    EstimateSilence,
    HealthSilence,
    LinkSilence,
    MapMonitor,
    PlanSilence,
    ProcessSilence,
)
from treadline.guard._slip_monitor import SlipMonitor
from treadline.guard._swept_outline import SweptOutline

RULES: tuple[type[Monitor], ...] = (
    Pace,
    PlantFault,
    LinkSilence,
    ProcessSilence,
    PlanSilence,
    BatteryMonitor,
    TiltMonitor,
    SeatMonitor,
    DriveSilence,
    BeltMonitor,
    SlipMonitor,
    EstimateSilence,
    BothSenses,
    Senses,
    FilterHealth,
    HealthSilence,
    MapMonitor,
    GyroOnlyTurn,
    TurnedOver,
    AheadMonitor,
    DropMonitor,
    SweptOutline,
)
