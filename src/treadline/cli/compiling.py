"""Why a first run is silent for a while: said on stderr, once."""

import sys

NOTICE = "compiling for this machine, which is kept for the next time; it takes about half a minute\n"


def tell_compiling() -> None:
    """Have the notice written should this verb have to compile for long."""
    from treadline.compiling import compiling

    compiling().tell_once(_tell)


def _tell() -> None:
    sys.stderr.write(NOTICE)
    sys.stderr.flush()
