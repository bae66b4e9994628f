"""Viewer in the browser: panels and controls around the scene, updated by one thread. ``Session -> page``."""

import json
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from html import escape
from typing import Any, get_args

from treadline.errors import SettingsError
from treadline.faults import EXTENTS, Conditions, Fault, FaultKind
from treadline.playback.recording import PHASES
from treadline.viewer.nosings import SeenNosings
from treadline.viewer.opening import Opened
from treadline.viewer.pages import camera_html, events_html, handset_html, state_html, timeline_html, transitions_html
from treadline.viewer.plots import RED, SKY, PlotSpec, legend_html, plot_data, plot_specs
from treadline.viewer.scene import NARROW_CAMERA_M, NARROW_LOOK_AT_M, SceneChoices, SceneView
from treadline.viewer.server import GuardedServer
from treadline.viewer.session import SPEEDS, Session

SCENE_S, TEXT_S, PLOT_S = 1.0 / 25.0, 0.1, 0.4
"""Intervals of the updates of scene, text and plots [s]."""
PLOT_PX = 72
"""Height of a plot [px]: six of them fit on a laptop's screen."""
NARROW_PX = 576
"""Largest width of a page that shows the panels at its lower edge [px], as in ``narrow.css``."""
OBSTACLE = "obstacle ahead (value in metres)"
CHANGES: dict[str, tuple[FaultKind, float, float, str]] = {
    "friction of the steps (× value)": ("low_friction", 1.0, 0.5, "factor on the friction of both belts, 0.1 to 2"),
    "friction, left belt (× value)": ("track_slip", 1.0, 0.5, "factor on the friction of the left belt, 0.1 to 2"),
    "friction, right belt (× value)": ("track_slip", -1.0, 0.5, "factor on the friction of the right belt, 0.1 to 2"),
    "passenger's weight forward (value in metres)": ("payload_forward", 1.0, 0.15, EXTENTS["payload_forward"].means),
    "passenger's weight to the left (value in metres)": ("payload_left", 1.0, 0.15, EXTENTS["payload_left"].means),
    "passenger's weight up (value in metres)": ("payload_up", 1.0, 0.15, EXTENTS["payload_up"].means),
    OBSTACLE: ("obstacle", 1.0, 1.2, "distance from the leading end to a box [m]"),
}
"""Changes that stay, by name: fault, sign of its value, default value, meaning."""
FRICTION_MIN, FRICTION_MAX = 0.1, 2.0
"""Range of the factor on the friction: from oil on the steps to twice the scenario's friction."""
FOREVER_S = 1e6
"""Duration of a change that stays [s]."""
WEIGHT: tuple[tuple[str, FaultKind], ...] = (("forward", "payload_forward"), ("left", "payload_left"), ("up", "payload_up"))
"""Directions in which the passenger's weight moves, with the faults of the same range."""
NO_FORK = (
    '<div style="font-size:12px">This run cannot be repeated: its log comes without scenario and seed, or it used plug-ins. '
    "Run folders of treadline climb can be forked.</div>"
)
"""Content of the tab of a run that cannot be forked."""
NOTHING = "nothing (must coincide)"


class App:
    """Page of a session.

    Args:
        server: Server with its access check.
        session: What is shown.
        opened: Target with its stage and title.
    """

    def __init__(self, server: GuardedServer, session: Session, opened: Opened) -> None:
        self._viser, self._session, self._opened = server.viser, session, opened
        stage = opened.stage
        self._scene = SceneView(server.viser, stage)
        self._choices = SceneChoices()
        self._nosings = SeenNosings(stage.staircase, stage.chair.camera_at(stage.image_height_px, rear=stage.rear_camera))
        self._lock = threading.Lock()
        self._texts: dict[int, str] = {}
        self._legends: list[Any] = []
        self._plots: list[Any] = []
        self._jumps: dict[str, float] = {}
        self._moving_slider = False
        self.failure: Exception | None = None
        """Exception that ended the updates; None while all is well."""
        self.updates = 0
        """Number of scene updates, for tests and measurements."""
        self._build()
        server.viser.on_client_connect(show_above_sheet)

    # Panels

    def _build(self) -> None:
        gui = self._viser.gui
        gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False, control_width="large")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(400)
        if self._session.attended:
            self._build_stop(gui)
        self._state = gui.add_html("")
        self._timeline = gui.add_html("")
        self._build_transport(gui)
        self._camera = gui.add_html("")
        tabs = gui.add_tab_group()
        with tabs.add_tab("Phases"):
            self._transitions = gui.add_html("")
        with tabs.add_tab("Events"):
            self._events = gui.add_html("")
        with tabs.add_tab("What if"):
            if self._opened.can_fork:
                self._build_what_if(gui)
            else:
                self._outcome = gui.add_html(NO_FORK)
        if self._session.attended:
            with tabs.add_tab("Control"):
                self._build_control(gui)
        with tabs.add_tab("Show"):
            self._build_choices(gui)
        panel = gui.add_panel()
        self._plot_tab = panel.add_tab("Plots")
        panel.dock_left()
        panel.set_width(380)

    def _build_transport(self, gui: Any) -> None:
        session = self._session
        self._slider = gui.add_slider("time [s]", min=0.0, max=1.0, step=0.01, initial_value=0.0)

        @self._slider.on_update
        def _(event: Any) -> None:
            if event.client is not None and not self._moving_slider:
                with self._lock:
                    session.seek(float(self._slider.value))

        buttons = gui.add_button_group("play", ("start", "−1", "play", "+1", "end"))

        @buttons.on_click
        def _(_event: Any) -> None:
            with self._lock:
                session.press_transport(str(buttons.value))

        speed = gui.add_dropdown("speed ×", tuple(f"{value:g}" for value in SPEEDS), initial_value="1")

        @speed.on_update
        def _(_event: Any) -> None:
            with self._lock:
                session.set_speed(float(speed.value))

        self._jump = gui.add_dropdown("go to", ("–",))

        @self._jump.on_update
        def _(event: Any) -> None:
            if event.client is not None and self._jump.value in self._jumps:
                with self._lock:
                    session.playing = False
                    session.seek(self._jumps[self._jump.value])

        for label, hotkey, ticks in (("Play or pause", "K", 0), ("Back one tick", "J", -1), ("Forward one tick", "L", 1)):
            command = gui.add_command(label, hotkey=hotkey)
            command.on_trigger(self._stepper(ticks))

    def _stepper(self, ticks: int) -> Callable[[Any], None]:
        def triggered(_event: Any) -> None:
            with self._lock:
                if ticks:
                    self._session.step(ticks)
                else:
                    self._session.play()

        return triggered

    def _build_what_if(self, gui: Any) -> None:
        session = self._session
        kinds = tuple(kind for kind in get_args(FaultKind) if kind not in ("operator_stop", "link_lost"))
        self._change = gui.add_dropdown("change", (NOTHING, *CHANGES, *kinds))
        self._value = gui.add_number("value (0: default)", 0.0, step=0.05)
        self._lasts = gui.add_number("for [s]", 5.0, min=0.1, step=0.5)
        hint = gui.add_html("")
        fork = gui.add_button("Fork here")
        drop = gui.add_button("Remove the fork")
        self._outcome = gui.add_html("")

        @self._change.on_update
        def _(_event: Any) -> None:
            hint.content = f'<div style="font-size:12px">{_meaning(self._change.value)}</div>'

        @fork.on_click
        def _(event: Any) -> None:
            try:
                change = _fault(self._change.value, float(self._value.value), float(self._lasts.value))
            except ValueError as error:
                _complain(event, error)
                return
            with self._lock:
                session.fork(change)

        @drop.on_click
        def _(_event: Any) -> None:
            with self._lock:
                session.drop_ghost()

    def _build_stop(self, gui: Any) -> None:
        """Add the buttons of the handset, in view at all times."""
        session = self._session
        stop = gui.add_button("STOP", color="red")
        rearm = gui.add_button("Re-arm")

        @stop.on_click
        def _(_event: Any) -> None:
            with self._lock:
                session.press("stop")

        @rearm.on_click
        def _(_event: Any) -> None:
            with self._lock:
                session.press("rearm")

    def _build_control(self, gui: Any) -> None:
        session = self._session
        manual = gui.add_checkbox("Drive by hand", initial_value=False)
        gui.add_html(
            '<div style="font-size:12px">Hold <b>Shift</b> (or a shoulder button of a gamepad) and drive with <b>W A S D</b>, the '
            "arrow keys or the left stick. Letting go, or leaving the page, stops the chair; then re-arm.</div>"
        )
        self._handset = gui.add_html("")
        kind = gui.add_dropdown("break something", (OBSTACLE, *get_args(FaultKind)))
        value = gui.add_number("value (0: default)", 0.0, step=0.05)
        lasts = gui.add_number("for [s]", 3.0, min=0.1, step=0.5)
        hint = gui.add_html("")
        inject = gui.add_button("Inject now")

        @kind.on_update
        def _(_event: Any) -> None:
            hint.content = f'<div style="font-size:12px">{_meaning(kind.value)}</div>'

        @manual.on_update
        def _(_event: Any) -> None:
            with self._lock:
                session.set_manual(manual=bool(manual.value))

        @inject.on_click
        def _(event: Any) -> None:
            try:
                change = _fault(kind.value, float(value.value), float(lasts.value))
            except ValueError as error:
                _complain(event, error)
                return
            if change is not None:
                with self._lock:
                    session.act(change.model_copy(update={"at_s": session.tape.end_s}))

        self._build_conditions(gui)

    def _build_conditions(self, gui: Any) -> None:
        session = self._session
        gui.add_html(
            '<div style="font-size:12px">From now on: factor on the friction of each belt, and the passenger\'s weight.</div>'
        )
        friction = [
            gui.add_slider(f"friction, {side} ×", min=FRICTION_MIN, max=FRICTION_MAX, step=0.05, initial_value=1.0)
            for side in ("left", "right")
        ]
        extents = [(label, EXTENTS[kind]) for label, kind in WEIGHT]
        weight = [
            gui.add_slider(f"weight {label} [m]", min=extent.low, max=extent.high, step=0.01, initial_value=0.0)
            for label, extent in extents
        ]

        def moved(event: Any) -> None:
            if event.client is not None:
                with self._lock:
                    session.act(
                        Conditions(
                            friction=(float(friction[0].value), float(friction[1].value)),
                            payload_m=(float(weight[0].value), float(weight[1].value), float(weight[2].value)),
                        )
                    )

        for slider in (*friction, *weight):
            slider.on_update(moved)

    def _build_choices(self, gui: Any) -> None:
        for name, label in (
            ("follow", "follow the chair"),
            ("passenger", "passenger"),
            ("planes", "detected treads and risers"),
            ("forces", "belt forces"),
            ("contacts", "contact forces"),
            ("swept", "swept volume"),
        ):
            box = gui.add_checkbox(label, initial_value=getattr(self._choices, name))
            box.on_update(self._chooser(box, name))
        self._contacts_note = gui.add_html("")

    def _chooser(self, box: Any, name: str) -> Callable[[Any], None]:
        def chosen(_event: Any) -> None:
            setattr(self._choices, name, bool(box.value))
            if name == "contacts":
                with self._lock:
                    self._session.ask_contacts(asked=bool(box.value))

        return chosen

    def _plot(self, gui: Any, spec: PlotSpec) -> Any:
        from viser import uplot

        lines = [uplot.Series(label="fork", stroke=SKY, width=1.4, points={"show": False}, show=spec.ghost is not None)]
        lines += [
            uplot.Series(
                label=curve.label,
                stroke=curve.colour,
                width=1.4,
                points={"show": False},
                **({"dash": (4, 3)} if curve.dashed else {}),
            )
            for curve in spec.curves
        ]
        lines += [uplot.Series(label="limit", stroke=RED, width=1.0, dash=(6, 4), points={"show": False}) for _ in spec.limits]
        lines.append(uplot.Series(label="cursor", stroke="#444", width=1.0, points={"show": False}))
        self._legends.append(gui.add_html(legend_html(spec, forked=False)))
        last = spec is plot_specs(self._session.tape.limits)[-1]
        return gui.add_uplot(
            data=plot_data(spec, self._session.tape, 0.0),
            series=(uplot.Series(label="t [s]"), *lines),
            scales={"x": uplot.Scale(time=False)},
            axes=(uplot.Axis(size=24) if last else uplot.Axis(show=False), uplot.Axis(size=38)),
            legend=uplot.Legend(show=False),
            height=PLOT_PX + (20 if last else 0),
            padding=(4, 8, 0, 0),
        )

    # Updates

    def run(self, ended: threading.Event) -> None:
        """Update the page until ``ended`` is set; a failure sets it and is kept."""
        try:
            self._update(ended)
        except Exception as error:  # noqa: BLE001 - raised again by the main thread
            self.failure = error
            ended.set()

    def _update(self, ended: threading.Event) -> None:
        before = time.perf_counter()
        due_text = due_plots = 0.0
        shown: tuple[Any, ...] | None = None
        while not ended.is_set():
            now = time.perf_counter()
            with self._lock:
                self._session.advance(now - before)
                t_s, end_s = self._session.cursor_s, self._session.tape.end_s
            before = now
            if self._session.feed.error is not None and not len(self._session.tape):
                raise SettingsError(self._session.feed.error)
            ghost = self._session.ghost
            known = len(self._session.tape.contacts), None if ghost is None else len(ghost.tape)
            key = (round(t_s, 3), vars_of(self._choices), known)
            if key != shown:
                shown = key
                self._show_scene(t_s)
            if now >= due_text:
                due_text = now + TEXT_S
                self._show_text(t_s, end_s)
            if now >= due_plots:
                due_plots = now + PLOT_S
                self._show_plots(t_s)
            ended.wait(max(SCENE_S - (time.perf_counter() - now), 0.001))

    def _show_scene(self, t_s: float) -> None:
        session = self._session
        with self._viser.atomic():
            self._scene.show(session.tape, t_s, self._choices, None if session.ghost is None else session.ghost.tape)
        self.updates += 1

    def _show_text(self, t_s: float, end_s: float) -> None:
        session, tape = self._session, self._session.tape
        self._say(self._state, state_html(tape, t_s, live=session.is_live, title=session.feed.error or self._opened.title))
        self._say(self._timeline, timeline_html(tape, t_s, None if session.ghost is None else session.ghost_from_s))
        self._say(self._transitions, transitions_html(tape, t_s))
        self._say(self._events, events_html(tape, t_s))
        look = tape.look_at(t_s)
        seen, missed = ([], []) if look is None else self._nosings.compare(look, tape.at(look.t_s))
        reasons = {} if look is None else {number: self._nosings.why_missed(number, look, tape.at(look.t_s)) for number in missed}
        self._say(self._camera, camera_html(look, seen, reasons, t_s))
        if self._opened.can_fork:
            self._say(self._outcome, outcome_html(session))
        if session.attended:
            self._say(self._handset, handset_html(session.handset, tape, t_s))
        note = session.contacts_note if self._choices.contacts else ""
        self._say(self._contacts_note, f'<div style="font-size:12px">{note}</div>')
        self._show_slider(t_s, end_s)
        jumps = {f"{span.start_s:.2f} s {span.name}": span.start_s for span in tape.phases}
        jumps |= {
            f"{event.t_s:.2f} s {event.name}: {event.cause}"[:60]: event.t_s for event in tape.events if event.name not in PHASES
        }
        if jumps.keys() != self._jumps.keys():
            self._jumps = jumps
            self._jump.options = ("–", *sorted(jumps, key=lambda label: jumps[label]))

    def _show_slider(self, t_s: float, end_s: float) -> None:
        self._moving_slider = True
        try:
            if abs(self._slider.max - max(end_s, 1.0)) > 0.5 or (end_s > 0.0 and not self._session.is_live):
                wanted = max(round(end_s, 2), 1.0)
                if self._slider.max != wanted:
                    self._slider.max = wanted
            value = min(round(t_s, 2), self._slider.max)
            if abs(self._slider.value - value) > 0.005:
                self._slider.value = value
        finally:
            self._moving_slider = False

    def _say(self, handle: Any, text: str) -> None:
        """Set the content of a panel, if it has changed."""
        if self._texts.get(id(handle)) != text:
            self._texts[id(handle)] = text
            handle.content = text

    def _show_plots(self, t_s: float) -> None:
        session = self._session
        key = f"{t_s:.2f} {len(session.tape)} {0 if session.ghost is None else len(session.ghost.tape)}"
        if self._texts.get(0) == key or not len(session.tape):
            return
        self._texts[0] = key
        ghost = None if session.ghost is None else session.ghost.tape
        if not self._plots:  # made after the first picture
            with self._plot_tab:
                self._plots = [self._plot(self._viser.gui, spec) for spec in plot_specs(self._session.tape.limits)]
        for handle, legend, spec in zip(self._plots, self._legends, plot_specs(self._session.tape.limits), strict=True):
            self._say(legend, legend_html(spec, forked=ghost is not None))
            handle.data = plot_data(spec, session.tape, t_s, ghost)


def vars_of(choices: SceneChoices) -> tuple[bool, ...]:
    """Return the choices as a comparable value."""
    return choices.planes, choices.forces, choices.contacts, choices.swept, choices.follow, choices.passenger


def outcome_html(session: Session) -> str:
    """Return how a fork went, next to the run."""
    ghost = session.ghost
    if ghost is None:
        return ""

    said = ghost.error or ghost.tape.verdict or f"simulated to {ghost.tape.end_s:.1f} s …"
    run = escape(session.tape.verdict or "–")
    return f'<div style="font-size:12px"><b>fork at {session.ghost_from_s:.2f} s</b>: {escape(said)}<br>run: {run}</div>'


def _meaning(choice: str) -> str:
    if choice == NOTHING:
        return "The plant is deterministic: the fork coincides with the run."
    if choice in CHANGES:
        return CHANGES[choice][3] + f"; default {CHANGES[choice][2]:g}, until the end of the run"
    extent = EXTENTS[choice]  # type: ignore[index]
    return f"value: {extent.means}" + (f"; default {extent.default:g}" if extent.low != extent.high else "")


def _fault(choice: str, value: float, lasts_s: float) -> Fault | None:
    """Return the fault behind a choice.

    Raises:
        ValueError: If the value means nothing for this kind.
    """
    if choice == NOTHING:
        return None
    if choice in CHANGES:
        kind, sign, default, _ = CHANGES[choice]
        if kind in ("low_friction", "track_slip") and value and not FRICTION_MIN <= value <= FRICTION_MAX:
            raise ValueError(f"value is {value:g}; a factor on the friction must be from {FRICTION_MIN:g} to {FRICTION_MAX:g}")
        return Fault(kind=kind, at_s=0.0, for_s=FOREVER_S, value=sign * (value or default))
    return Fault(kind=choice, at_s=0.0, for_s=lasts_s, value=value)  # type: ignore[arg-type]


def _last_line(error: ValueError) -> str:
    """Return the sentence about the value: pydantic adds a heading and a link."""
    lines = str(error).splitlines()
    return lines[-2 if len(lines) > 1 else 0].strip()


def _complain(event: Any, error: ValueError) -> None:
    if event.client is not None:
        event.client.add_notification(title="not injected", body=_last_line(error), color="red")


def show_above_sheet(client: Any) -> None:
    """Turn the first view of a narrow screen, whose lower part the panels cover, so that the chair is above them."""
    if client.camera.image_width <= NARROW_PX:
        client.camera.position, client.camera.look_at = NARROW_CAMERA_M, NARROW_LOOK_AT_M


def handset_handler(session: Session) -> Callable[[Any], Any]:
    """Return the handler of the handset's connection: reports in, whether a person drives out."""

    async def serve(connection: Any) -> None:
        import asyncio

        from websockets.exceptions import ConnectionClosed

        async def report() -> None:
            with suppress(ConnectionClosed):
                while True:
                    await connection.send(json.dumps({"manual": session.manual}))
                    await asyncio.sleep(0.2)

        reporting = asyncio.create_task(report())
        try:
            async for message in connection:
                state = json.loads(message)
                session.report(
                    dead_man=state.get("dead_man") is True, ahead=float(state.get("ahead", 0)), turn=float(state.get("turn", 0))
                )
        except ConnectionClosed:
            pass  # the page is gone; the dead-man switch is released by the silence
        except (ValueError, TypeError, AttributeError):
            await connection.close(1003, "not a report of the handset")
        finally:
            reporting.cancel()

    return serve
