"""``treadline demo``: a recorded climb in the browser at once, and the same climb live once its kernels are compiled."""

from treadline.cli._output import Answer
from treadline.cli._serving import serve


def demo(*, host: str = "127.0.0.1", port: int | None = None, no_browser: bool = False, seconds: float | None = None) -> Answer:
    """Watch a tracked chair climb a stair in the browser, within seconds.

    The page plays a recorded climb of a stair of 28°: chair and stair in 3D, plots with the guard's limits, and phases with their
    reasons. Meanwhile the simulator is compiled for this machine, once, in the background; then the button "Run it live" simulates
    the same climb anew, with the camera's images. Next: treadline climb up-28 --out runs/first; treadline view runs/first.

    Only this machine can open the page, by the printed address with its secret token. Without a browser the page is served all the
    same.

    Args:
        host: Address to listen on. Any other than the default exposes the page to the network, in plain HTTP.
        port: Port to listen on; 0 takes any free one. Default: the first free one from 8350 on.
        no_browser: Print the address and open no browser.
        seconds: Time after which the demo ends [s]. Default: until Ctrl-C.
    """
    from treadline.view.opening import LiveOffer, open_demonstration

    return serve("demo", open_demonstration, host=host, port=port, no_browser=no_browser, seconds=seconds, offer=LiveOffer())
