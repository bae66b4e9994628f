"""Make the controller that is shipped for a vehicle: excite at 20°, identify, tune with the default weights.

With Table I's friction no belt difference turns a chair that is square to a stair of 28°, so nothing is to be identified there.

    python examples/make_controller.py wheelchair

Seed 100 is none of those that ``treadline reproduce`` reports.
"""

import sys
from dataclasses import replace

from treadline.control import tune
from treadline.experiments.plan import CONTROLLER_GROUND, excitation
from treadline.identification import IdentificationOptions, identify
from treadline.run.excitation_run import PERIOD_S, excite
from treadline.scenario.shipped_files import CONTROLLERS

SEED, SAMPLES = 100, 1000
PAYLOAD_KG = {"wheelchair": 50.0, "wheelchair-35": 50.0, "wheelchair-fixed": 50.0, "rescue": 3.0}
"""Table I's person; a camera head with a lamp and a radio."""

vehicle = sys.argv[1] if len(sys.argv) > 1 else "wheelchair"
scenario = excitation(CONTROLLER_GROUND)
loading = scenario.chair.model_copy(update={"model": vehicle, "payload_kg": PAYLOAD_KG[vehicle]})
excited = excite(scenario.model_copy(update={"chair": loading}), samples=SAMPLES, period_s=PERIOD_S, seed=SEED)
found = identify(excited.record, IdentificationOptions(method="okid-era"))
origin = {
    "made_by": f"examples/make_controller.py {vehicle}",
    "slope_deg": CONTROLLER_GROUND.slope_deg,
    "friction": list(CONTROLLER_GROUND.friction),
    "payload_kg": PAYLOAD_KG[vehicle],
    "seed": SEED,
    "samples": len(excited.record),
    "yaw_rate_vaf_percent": round(found.report.one_step_vaf_percent["yaw_rate_rad_s"], 1),
}
design = tune(found.model, vehicle=vehicle)
replace(design, provenance=design.provenance | origin).save(CONTROLLERS / f"{vehicle}.json")
print(f"order {found.report.order}, yaw-rate VAF {origin['yaw_rate_vaf_percent']} %, K = {design.K.round(4).tolist()}")
