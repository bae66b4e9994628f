"""Write every drawing into the folder that the command names."""

import sys
from pathlib import Path

from drawings.paper_figures import write_drawings

write_drawings(Path(sys.argv[1]))
