"""Write your own stair detector: the shipped one, with headings that disagree with the last three left out.

python examples/own_detector.py
treadline climb up-28 --detector examples/own_detector.py:MedianDetector --out runs/detector
"""

from collections import deque
from statistics import median
from types import SimpleNamespace

import treadline as tl
from treadline.perception import DetectorConfig, StairDetector


class MedianDetector:
    maps_stair = True  # `see` returns a stair map, so that full traversals are possible

    def __init__(self, config):  # a MissionConfig: chair, payload, speed
        self.detector = StairDetector(DetectorConfig(swept_half_m=config.chair.swept_half_m))
        self.last = deque(maxlen=3)

    def see(self, frame, gravity_C=None):  # RgbdFrame, vector -> measurement and stair_map, None where nothing was found
        seen = self.detector.see(frame, gravity_C)
        if (found := seen.measurement) is None:
            return SimpleNamespace(measurement=None, stair_map=None)
        self.last.append(found.heading_rad)
        is_outlier = abs(found.heading_rad - median(self.last)) > 3.0 * found.sigma_rad
        return SimpleNamespace(measurement=None if is_outlier else found, stair_map=seen.stair_map)


if __name__ == "__main__":
    print(
        tl.climb(tl.Scenario.model_validate({"drive": {"duration_s": 6.0}, "start": {"heading_deg": 5.0}}), detector=MedianDetector)
    )
