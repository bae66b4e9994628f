"""Viewer in the browser: panels and controls around the scene, updated by one thread. ``Session -> page``."""

import json
import math
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from html import escape
from typing import Any

from treadline.core.errors import SettingsError
from treadline.scenario.faults import EXTENTS, Conditions, FaultKind
from treadline.view._messages import SEND_S
from treadline.view._panels import HTML, PANELS, STYLE, legend_html, way_html
from treadline.view._plots import LOADING, add_plot, plot_data, shown_plots
from treadline.view._scene import NARROW_CAMERA_M, NARROW_LOOK_AT_M, SHOWN, SceneView
from treadline.view._session import SPEEDS, TRANSPORT, Session
from treadline.view._what_if import FORKS, FRICTION_MAX, FRICTION_MIN, INJECTIONS, ChangeForm
from treadline.view.opening import LiveOffer
from treadline.view.server import GuardedServer

TEXT_S, PLOT_S = 0.1, 0.4
"""Intervals of the updates of text and plots [s]; the scene has that of the simulation's messages."""
MESSAGE_MAX = 1024
"""Largest length of a message of the page: ten times that of the handset's report."""
NARROW_PX = 576
"""Largest width of a page that shows the panels at its lower edge [px], as in ``narrow.css``."""
PANELS_SHARE, PLOTS_SHARE = 0.27, 0.22
"""Largest shares of the page's width that the panels at the right and the plots at the left take: half of it is the scene's."""
PANELS_PX, PLOTS_PX = 400, 380
"""Largest widths of the panels and of the plots [px]."""
FOLDED_PX = 900
"""Width of the page below which the plots are folded [px]: their values would not fit next to each other."""
WEIGHT: tuple[tuple[str, FaultKind], ...] = (("forward", "payload_forward"), ("left", "payload_left"), ("up", "payload_up"))
"""Directions in which the passenger's weight moves, with the faults of the same range."""
DRIVING = (
    "Hold <b>Shift</b> (or a shoulder button of a gamepad) and drive with <b>W A S D</b>, the arrow keys or the left stick. "
    "Letting go, or leaving the page, stops the chair; then re-arm."
)
"""How a person drives the chair."""
CONDITIONS = "From now on: factor on the friction of each belt, and the passenger's weight."
"""Meaning of the sliders of the control panel."""


class App:
    """Page of a session, and of the live run in its place once a person has taken the offer.

    Args:
        server: Server with its access check.
        session: What is shown first.
        offer: Live run that the page offers, if any.
    """

    def __init__(self, server: GuardedServer, session: Session, offer: LiveOffer | None = None) -> None:
        self._viser, self._offer = server.viser, offer
        self._is_offered, self._is_begun = offer is not None, False
        self._lock = threading.Lock()
        self.timeline = ""
        """Phases as a bar, in HTML."""
        self.updates = 0
        """Number of scene updates, for tests and measurements."""
        self.failure: Exception | None = None
        """Exception that ended the updates; None while all is well."""
        self._begin(session)
        self.fit(math.inf)
        server.viser.on_client_connect(_show_above_sheet)

    def _begin(self, session: Session) -> None:
        """Build the page of a session."""
        self.session, self._is_taken = session, False
        self._scene = SceneView(self._viser, session.feed)
        session.shows.update({name: shown for name, (_, shown) in SHOWN.items()})
        self._panels: dict[str, Any] = {}
        self._plots: list[tuple[Any, Any, Any]] = []
        self._plotted: tuple[Any, ...] = ()
        self._way: Any = None
        self._widths: tuple[float, float, bool] = (0.0, 0.0, False)
        self._build()

    def _take(self) -> None:
        self._is_taken = True

    # Controls

    def _build(self) -> None:
        gui, session = self._viser.gui, self.session
        gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False, control_width="large")
        gui.main_panel.dock_right()
        if self._is_offered:
            self._status = gui.add_html("")
            self._take_offer = self._add_button("Run it live", self._take, visible=False)
        if session.attended:
            self._add_button("STOP", lambda: session.press("stop"), color="red")
            self._add_button("Re-arm", lambda: session.press("rearm"))
            self._add_button("This is the end", lambda: session.press("flight_ends"))
            self._add_button("Go back", lambda: session.press("go_back"))
        self._place("state", "camera")
        gui.add_command("Play or pause", hotkey="K").on_trigger(self._locked(lambda _event: session.play()))
        gui.add_command("Back one tick", hotkey="J").on_trigger(self._locked(lambda _event: session.step(-1)))
        gui.add_command("Forward one tick", hotkey="L").on_trigger(self._locked(lambda _event: session.step(1)))
        tabs = gui.add_tab_group()
        for label, name in (("Moments", "answers"), ("Events", "events")):
            with tabs.add_tab(label):
                self._place(name)
        with tabs.add_tab("What if"):
            if session.can_repeat:
                self._build_what_if(gui)
            self._place("outcome")
        if session.attended:
            with tabs.add_tab("Control"):
                self._build_control(gui)
        with tabs.add_tab("Show"):
            self._build_choices(gui)
        self._plot_panel = gui.add_panel()
        self._plot_tab = self._plot_panel.add_tab("Plots")
        with self._plot_tab:
            self._loading = gui.add_html(LOADING)
        self._plot_panel.dock_left()

    def fit(self, page_px: float) -> None:
        """Give panels and plots their shares of a page's width; a small page folds the plots, and a narrow one has a sheet."""
        widths = min(PANELS_PX, PANELS_SHARE * page_px), min(PLOTS_PX, PLOTS_SHARE * page_px), page_px < FOLDED_PX
        if page_px <= NARROW_PX or widths == self._widths:
            return
        if widths[2] != self._widths[2]:
            (self._plot_panel.minimize if widths[2] else self._plot_panel.expand)()
        self._widths, self._page_px = widths, page_px
        self._viser.gui.main_panel.set_width(widths[0])
        self._plot_panel.set_width(widths[1])

    def _place(self, *names: str) -> None:
        """Add panels of text."""
        self._panels |= {name: self._viser.gui.add_html("") for name in names}

    def _add_button(self, label: str, act: Callable[[], None], **look: Any) -> Any:
        button = self._viser.gui.add_button(label, **look)
        button.on_click(self._locked(lambda _event: act()))
        return button

    def _locked(self, act: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return a handler of events that acts while the page is not updated."""

        def handle(event: Any) -> None:
            with self._lock:
                act(event)

        return handle

    def take(self, message: str | bytes) -> None:
        """Take a message of the page: a time to jump to, a button of the timeline, a speed, the page's width, or the handset.

        Any other message is dropped and counted.
        """
        try:
            self._follow(json.loads(message[:MESSAGE_MAX]))  # the beginning of a longer message is not JSON
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
            self.session.dropped += 1

    def _follow(self, said: Mapping[str, Any]) -> None:
        session = self.session
        if "dead_man" in said:  # without waiting for an update: a late report is a released switch
            session.report(dead_man=said["dead_man"] is True, ahead=_finite(said["ahead"]), turn=_finite(said["turn"]))
            return
        with self._lock:
            if "t_s" in said:
                t_s = _finite(said["t_s"])
                session.playing &= session.feed.is_live  # a recording stays there
                session.seek(t_s)
            elif "press" in said:
                session.press_transport(str(said["press"]))
            elif said.get("speed") in SPEEDS:
                session.set_speed(float(said["speed"]))
            elif "width_px" in said:
                self.fit(_finite(said["width_px"]))

    def state(self) -> dict[str, Any]:
        """Return what the page's timeline and handset show."""
        session = self.session
        times = {"t_s": session.cursor_s, "end_s": session.run.duration_s, "playing": session.playing, "speed": session.speed}
        return {"manual": session.manual, "timeline": self.timeline, "buttons": TRANSPORT, "speeds": SPEEDS, **times}

    def _build_what_if(self, gui: Any) -> None:
        form = ChangeForm(gui, "change", FORKS)
        button = gui.add_button("Fork here", hint="repeat the run up to the cursor, and go on with the change")
        self._drop = self._add_button("Remove the fork", self.session.drop_ghost, visible=False)
        self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)
        form.add_hint(gui)

        def fork(event: Any) -> None:
            taken = form.take(event)
            if taken is not None:
                self.session.fork(*taken)

        button.on_click(self._locked(fork))

    def _build_control(self, gui: Any) -> None:
        session = self.session
        manual = gui.add_checkbox("Drive by hand", initial_value=False)
        manual.on_update(self._locked(lambda _event: session.set_manual(manual=bool(manual.value))))
        gui.add_html(f'<div style="font-size:12px">{DRIVING}</div>')
        self._place("handset")
        form = ChangeForm(gui, "break something", INJECTIONS)
        button = gui.add_button("Inject now")
        form.add_hint(gui)

        def inject(event: Any) -> None:
            fault, _ = form.take(event) or (None, "")
            if fault is not None:
                session.act(fault.model_copy(update={"at_s": session.run.duration_s}))

        button.on_click(self._locked(inject))
        self._build_conditions(gui)

    def _build_conditions(self, gui: Any) -> None:
        gui.add_html(f'<div style="font-size:12px">{CONDITIONS}</div>')
        friction = [
            gui.add_slider(f"friction, {side} ×", min=FRICTION_MIN, max=FRICTION_MAX, step=0.05, initial_value=1.0)
            for side in ("left", "right")
        ]
        weight = [
            gui.add_slider(f"weight {label} [m]", min=EXTENTS[kind].low, max=EXTENTS[kind].high, step=0.01, initial_value=0.0)
            for label, kind in WEIGHT
        ]

        def moved(event: Any) -> None:
            if event.client is not None:
                left, right, *shift_m = (float(slider.value) for slider in (*friction, *weight))
                self.session.act(Conditions(friction=(left, right), payload_m=(shift_m[0], shift_m[1], shift_m[2])))

        for slider in (*friction, *weight):
            slider.on_update(self._locked(moved))

    def _build_choices(self, gui: Any) -> None:
        for name, (label, shown) in SHOWN.items():
            box = gui.add_checkbox(label, initial_value=shown)
            box.on_update(self._locked(partial(self._choose, box, name)))
        self._place("contacts")
        gui.add_html(str(HTML.legend()))
        gui.add_html(str(HTML.terms()))

    def _choose(self, box: Any, name: str, _event: Any) -> None:
        self.session.shows[name] = bool(box.value)
        if name == "contacts":
            self.session.ask_contacts(asked=bool(box.value))

    def close(self) -> None:
        """End all workers."""
        self.session.close()
        if self._offer is not None:
            self._offer.close()

    async def page(self, connection: Any) -> None:
        """Serve the page's own connection: messages of the page in, the state of timeline and handset out."""
        import asyncio

        from websockets.exceptions import ConnectionClosed

        async def report() -> None:
            known: dict[str, Any] = {}
            with suppress(ConnectionClosed):
                while True:
                    state = self.state()
                    if changed := {name: value for name, value in state.items() if value != known.get(name)}:
                        await connection.send(json.dumps(changed))
                    known = state
                    await asyncio.sleep(TEXT_S)

        if self._offer is not None and not self._is_begun:
            self._is_begun = True
            self._offer.begin()
            self.session.play(playing=True)
        reporting = asyncio.create_task(report())
        try:
            async for message in connection:
                self.take(message)
        except ConnectionClosed:
            pass  # the page is gone; the dead-man switch is released by the silence
        finally:
            reporting.cancel()

    # Updates

    def run(self, ended: threading.Event) -> None:
        """Update the page until ``ended`` is set; a failure sets it and is kept."""
        try:
            self._update(ended)
            if self._is_taken and self._offer is not None:
                self._switch(self._offer.open())
                self._update(ended)
        except Exception as error:  # noqa: BLE001 - raised again by the main thread
            self.failure = error
            ended.set()

    def _switch(self, session: Session) -> None:
        """Show the live run in the same page."""
        self.session.close()
        self._viser.scene.reset()
        self._viser.gui.reset()
        self._is_offered = False
        self._begin(session)
        self.fit(self._page_px)

    def _update(self, ended: threading.Event) -> None:
        """Update the page until ``ended`` is set or the offer is taken."""
        session, feed = self.session, self.session.feed
        before = time.perf_counter()
        due_text = due_plots = 0.0
        shown: tuple[Any, ...] = ()
        while not ended.is_set() and not self._is_taken:
            now = time.perf_counter()
            with self._lock:
                session.advance(now - before)
            before = now
            if feed.error is not None and feed.is_empty:
                raise SettingsError(feed.error)
            fork = session.ghost
            grown = len(feed.contacts), None if fork is None else len(fork.feed.recording.t_s)
            key = (round(session.cursor_s, 3), tuple(session.shows.values()), grown)
            if key != shown:
                shown = key
                self.updates += 1
                with self._viser.atomic():
                    self._scene.show(session.cursor_s, session.shows, fork)
            if now >= due_text:
                due_text = now + TEXT_S
                self._show_text()
            if now >= due_plots:
                due_plots = now + PLOT_S
                self._show_plots()
            ended.wait(max(SEND_S - (time.perf_counter() - now), 0.001))

    def _show_text(self) -> None:
        session = self.session
        session.moments.update(session.feed)
        if self._offer is not None and self._is_offered:
            change(self._status, "content", f'<div style="{STYLE}">{escape(self._offer.status)}</div>')
            change(self._take_offer, "visible", self._offer.is_ready)
        if session.can_repeat:
            self._show_progress()
        for name, panel in self._panels.items():
            change(panel, "content", str(PANELS[name](session)))
        self.timeline = str(HTML.timeline(session))

    def _show_progress(self) -> None:
        """Show how far the fork is."""
        session, fork = self.session, self.session.ghost
        is_busy = fork is not None and fork.feed.is_live
        change(self._drop, "visible", fork is not None)
        change(self._progress, "visible", is_busy)
        if fork is not None:
            change(self._drop, "label", "Cancel the fork" if is_busy else "Remove the fork")
            change(
                self._progress,
                "value",
                round(100.0 * min(fork.feed.recording.duration_s / max(session.run.duration_s, 1.0), 1.0), 1),
            )
            if not is_busy:
                fork.moments.update(fork.feed)

    def _show_plots(self) -> None:
        session, run = self.session, self.session.run
        ghost = session.ghost
        fork = None if ghost is None else ghost.feed.recording
        key = round(session.cursor_s, 2), len(run.t_s), None if fork is None else len(fork.t_s)
        if key == self._plotted or session.feed.is_empty:
            return
        self._plotted = key
        if not self._plots:  # made after the first picture
            gui, plots = self._viser.gui, shown_plots(run)
            self._loading.remove()
            with self._plot_tab:
                self._plots = [(plot, gui.add_html(""), add_plot(gui, plot, run, is_last=plot is plots[-1])) for plot in plots]
        if way := way_html(session):
            if self._way is None:
                with self._plot_panel.add_tab("Way"):
                    self._way = self._viser.gui.add_html("")
            change(self._way, "content", way)
        for plot, legend, handle in self._plots:
            change(legend, "content", legend_html(plot, run, session.cursor_s, forked=fork is not None))
            handle.data = plot_data(plot, run, session.cursor_s, fork)


def _finite(value: Any) -> float:
    if not math.isfinite(value):
        raise ValueError
    return float(value)


def change(handle: Any, name: str, value: Any) -> None:
    """Set a property of a control, if it has changed: each assignment is a message to all clients."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)


def _show_above_sheet(client: Any) -> None:
    """Turn the first view of a narrow screen, whose lower part the panels cover, so that the chair is above them."""
    if client.camera.image_width <= NARROW_PX:
        client.camera.position, client.camera.look_at = NARROW_CAMERA_M, NARROW_LOOK_AT_M
