from treadline.api.feasibility import check as check
from treadline.api.models import identify as identify
from treadline.api.models import load_model as load_model
from treadline.api.models import tune as tune
from treadline.api.simulation import climb as climb
from treadline.api.vision import detect_stair as detect_stair
from treadline.identification.options import IdentificationOptions as IdentificationOptions
from treadline.io.frames import read_frames as read_frames

__version__: str
