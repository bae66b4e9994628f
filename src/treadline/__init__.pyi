from treadline.api import Run as Run
from treadline.api import check as check
from treadline.api import climb as climb
from treadline.api import identify as identify
from treadline.api import load_model as load_model
from treadline.api import read_scenario as read_scenario
from treadline.api import scenarios as scenarios
from treadline.api import tune as tune
from treadline.control.c_export import export as export
from treadline.core.models import LinearModel as LinearModel
from treadline.identification import Identified as Identified
from treadline.identification.options import IdentificationOptions as IdentificationOptions
from treadline.io.frames import frame_of_points as frame_of_points
from treadline.io.frames import read_frames as read_frames
from treadline.io.frames.single_frame import detect_ground as detect_ground
from treadline.io.frames.single_frame import detect_stair as detect_stair
from treadline.scenario import Scenario as Scenario
from treadline.sweeps import Sweep as Sweep
from treadline.sweeps import sweep as sweep

__version__: str

def gone(*names: str) -> str | None: ...
