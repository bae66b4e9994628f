"""The command line, with flights that take a while and cost nothing; its processes find them by this folder."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

if __name__ == "__main__":
    import flown

    from treadline.cli import main, sweep

    sweep.RunScenario = lambda **_: flown.slow
    sys.exit(main())
