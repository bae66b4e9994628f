"""``python -m treadline`` is ``treadline``."""

import sys

from treadline.cli import main

sys.exit(main())
