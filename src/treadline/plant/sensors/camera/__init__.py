"""RGB-D camera of a simulated chair, without OpenGL: rendered frames with the errors of a depth sensor.

Contract: ``Camera`` renders a staircase or any list of ``solids``;
``stair_frames`` and ``write_frames`` make folders of frames with ground truth.
"""

from treadline.plant.sensors.camera.frame_folder import TrueFrame, stair_frames, write_frames
from treadline.plant.sensors.camera.ray_camera import TEXTURES, Camera, ExactView, RenderedFrame
