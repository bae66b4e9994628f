"""Make the controller that is shipped for the wheelchair: excite at 28°, identify, tune with the default weights.

    python examples/make_controller.py src/treadline/data/controllers/wheelchair.json

Seed 100 is none of those that ``treadline reproduce`` reports.
"""

import sys
from dataclasses import replace
from pathlib import Path

from treadline.control import tune
from treadline.experiments.excite import PERIOD_S, excite
from treadline.experiments.plan import CONTROLLER_SLOPE_DEG, excitation
from treadline.identification import identify

SEED, SAMPLES = 100, 1000

excited = excite(excitation(CONTROLLER_SLOPE_DEG), samples=SAMPLES, period_s=PERIOD_S, seed=SEED)
found = identify(excited.record, method="okid-era")
origin = {
    "made_by": "examples/make_controller.py",
    "slope_deg": CONTROLLER_SLOPE_DEG,
    "seed": SEED,
    "samples": len(excited.record),
    "yaw_rate_vaf_percent": round(found.report.one_step_vaf_percent["yaw_rate_rad_s"], 1),
}
design = tune(found.model)
replace(design, provenance=design.provenance | origin).save(Path(sys.argv[1]))
print(f"order {found.report.order}, yaw-rate VAF {origin['yaw_rate_vaf_percent']} %, K = {design.K.round(4).tolist()}")
