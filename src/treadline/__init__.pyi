from treadline.api import check as check
from treadline.api import climb as climb
from treadline.api import detect_stair as detect_stair
from treadline.api import identify as identify
from treadline.api import load_model as load_model
from treadline.api import tune as tune
from treadline.identification.options import IdentificationOptions as IdentificationOptions
from treadline.io.frames import read_frames as read_frames

__version__: str
