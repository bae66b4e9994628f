"""Command line with slow episodes without a simulator; worker processes find them through this folder."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

if __name__ == "__main__":
    import short_runs

    from treadline import sweeps
    from treadline.cli import main

    sweeps.RunScenario = lambda **_: short_runs.slow
    sys.exit(main())
