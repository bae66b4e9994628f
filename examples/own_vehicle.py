"""Describe your own vehicle: a longer chair from the shipped one's file, checked before a controller exists for it."""

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import treadline as tl
from treadline.core.errors import SettingsError
from treadline.scenario.shipped_files import CHAIRS

text = (CHAIRS / "wheelchair.toml").read_text(encoding="utf-8")
text = re.sub(r'^name = ".*"', 'name = "long-chair"', text, flags=re.MULTILINE)
text = re.sub(r"^flat_run_m = .*", "flat_run_m = 1.10", text, flags=re.MULTILINE)

with TemporaryDirectory() as folder:
    Path(folder, "long-chair.toml").write_text(text, encoding="utf-8")
    scenario = Path(folder, "scenario.toml")
    scenario.write_text('[chair]\nmodel = "long-chair.toml"\n', encoding="utf-8")
    for slope_deg in (28, 44):
        print(f"{slope_deg}°:", tl.check(scenario, set={"stair.slope_deg": slope_deg}))
    try:
        tl.climb(scenario)
    except SettingsError as error:
        print("next:", error)
