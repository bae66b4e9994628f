"""Viewer in the browser: panels and controls around the scene, updated by one thread. ``Session -> page``."""

import json
import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from html import escape
from typing import Any

from treadline.core.errors import SettingsError
from treadline.scenario.faults import EXTENTS, Conditions, FaultKind
from treadline.view.moment_panel import RunMoments
from treadline.view.nosing_lines import SeenNosings
from treadline.view.opening import Opened
from treadline.view.pages import (
    answers_html,
    camera_html,
    camera_warning,
    events_html,
    handset_html,
    legend_of_scene,
    state_html,
    terms_html,
    timeline_html,
    transitions_html,
)
from treadline.view.plot_panels import RED, SKY, PlotSpec, legend_html, plot_data, plot_specs
from treadline.view.scene_3d import NARROW_CAMERA_M, NARROW_LOOK_AT_M, SceneChoices, SceneView
from treadline.view.server import GuardedServer
from treadline.view.session import SPEEDS, STEPS, TRANSPORT, Session
from treadline.view.whatif import (
    CHANGES,
    FORKS,
    FRICTION_MAX,
    FRICTION_MIN,
    INJECTIONS,
    LASTS_S,
    complain,
    fault_of,
    meaning,
    outcome_html,
    said_of,
)

SCENE_S, TEXT_S, PLOT_S = 1.0 / 25.0, 0.1, 0.4
"""Intervals of the updates of scene, text and plots [s]."""
PLOT_PX = 72
"""Height of a plot [px]: six of them fit on a laptop's screen."""
NARROW_PX = 576
"""Largest width of a page that shows the panels at its lower edge [px], as in ``narrow.css``."""
EDITED_S = 0.8
"""Time after a client's edit of the time box for which the server leaves it alone [s]: longer than between two typed digits."""
WEIGHT: tuple[tuple[str, FaultKind], ...] = (("forward", "payload_forward"), ("left", "payload_left"), ("up", "payload_up"))
"""Directions in which the passenger's weight moves, with the faults of the same range."""
NO_FORK = (
    '<div style="font-size:12px">This run cannot be repeated: its log comes without scenario and seed, or it used plug-ins. '
    "Run folders of treadline climb can be forked.</div>"
)
"""Content of the tab of a run that cannot be forked."""


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
        self._edited_at = -math.inf
        self._is_stale = False
        self._moments = RunMoments(chair=stage.chair, recording=opened.recording)
        self._ghost_moments = RunMoments(chair=stage.chair)
        self._forked_at = 0.0
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
        with tabs.add_tab("Moments"):
            self._answers = gui.add_html("")
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
            if event.client is not None:
                self._edited_at = time.perf_counter()
                self.jump(float(self._slider.value))

        for label, names in (("play", TRANSPORT), ("step", tuple(STEPS))):
            self._add_transport(gui, label, names)

        speed = gui.add_dropdown("speed ×", tuple(f"{value:g}" for value in SPEEDS), initial_value="1")

        @speed.on_update
        def _(_event: Any) -> None:
            with self._lock:
                session.set_speed(float(speed.value))

        for label, hotkey, ticks in (("Play or pause", "K", 0), ("Back one tick", "J", -1), ("Forward one tick", "L", 1)):
            command = gui.add_command(label, hotkey=hotkey)
            command.on_trigger(self._stepper(ticks))

    def _add_transport(self, gui: Any, label: str, names: tuple[str, ...]) -> None:
        buttons = gui.add_button_group(label, names)

        @buttons.on_click
        def _(_event: Any) -> None:
            with self._lock:
                self._session.press_transport(str(buttons.value))

    def jump(self, t_s: float) -> None:
        """Move the cursor, and stay there."""
        with self._lock:
            if not self._session.is_live:
                self._session.playing = False
            self._session.seek(t_s)

    def _stepper(self, ticks: int) -> Callable[[Any], None]:
        def triggered(_event: Any) -> None:
            with self._lock:
                if ticks:
                    self._session.step(ticks)
                else:
                    self._session.play()

        return triggered

    def _build_form(self, gui: Any, label: str, choices: tuple[str, ...]) -> tuple[Any, Any, Any]:
        """Add choice, value and duration of a change; a choice fills in its default value."""
        choice = gui.add_dropdown(label, choices)
        value = gui.add_number("value", 0.0, step=0.05)
        lasts = gui.add_number("for [s]", LASTS_S, min=0.1, step=0.5)

        def fill() -> None:
            change = CHANGES.get(choice.value)
            value.value = 0.0 if change is None else change.default
            value.disabled = change is None or not change.has_value
            lasts.disabled = change is None or change.stays

        choice.on_update(lambda _event: fill())
        fill()
        return choice, value, lasts

    def _add_hint(self, gui: Any, choice: Any) -> None:
        hint = gui.add_html("")

        def show() -> None:
            hint.content = f'<div style="font-size:12px;margin-right:14px">{escape(meaning(choice.value))}</div>'

        choice.on_update(lambda _event: show())
        show()

    def _build_what_if(self, gui: Any) -> None:
        session = self._session
        choice, value, lasts = self._build_form(gui, "change", FORKS)
        fork = gui.add_button("Fork here", hint="repeat the run up to the cursor, and go on with the change")
        self._drop = gui.add_button("Remove the fork", visible=False)
        self._progress = gui.add_progress_bar(0.0, visible=False, animated=True)
        self._add_hint(gui, choice)
        self._outcome = gui.add_html("")

        @fork.on_click
        def _(event: Any) -> None:
            chosen = choice.value, float(value.value), float(lasts.value)
            try:
                change = fault_of(*chosen)
            except ValueError as error:
                complain(event, error)
                return
            self._ghost_moments = RunMoments(chair=self._opened.stage.chair)
            self._forked_at = time.perf_counter()
            with self._lock:
                session.fork(change, said_of(*chosen))

        @self._drop.on_click
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
        choice, value, lasts = self._build_form(gui, "break something", INJECTIONS)
        inject = gui.add_button("Inject now")
        self._add_hint(gui, choice)

        @manual.on_update
        def _(_event: Any) -> None:
            with self._lock:
                session.set_manual(manual=bool(manual.value))

        @inject.on_click
        def _(event: Any) -> None:
            try:
                change = fault_of(choice.value, float(value.value), float(lasts.value))
            except ValueError as error:
                complain(event, error)
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
            ("forces", "belt forces (live runs)"),
            ("contacts", "contact forces"),
            ("swept", "swept volume"),
        ):
            box = gui.add_checkbox(label, initial_value=getattr(self._choices, name))
            box.on_update(self._chooser(box, name))
        self._contacts_note = gui.add_html("")
        gui.add_html(legend_of_scene())
        gui.add_html(terms_html())

    def _chooser(self, box: Any, name: str) -> Callable[[Any], None]:
        def chosen(_event: Any) -> None:
            setattr(self._choices, name, bool(box.value))
            if name == "contacts":
                with self._lock:
                    self._session.ask_contacts(asked=bool(box.value))

        return chosen

    def _plot(self, gui: Any, spec: PlotSpec) -> Any:
        from viser import uplot

        # Values under the pointer are those of the curves: see page.css.
        aid: dict[str, Any] = {"class": "treadline-aid"}
        lines = [uplot.Series(**aid, label="fork", stroke=SKY, width=1.4, points={"show": False}, show=spec.ghost is not None)]
        lines += [
            uplot.Series(**aid, label="limit", stroke=RED, width=1.0, dash=(6, 4), points={"show": False}) for _ in spec.limits
        ]
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
        lines.append(uplot.Series(**aid, label="cursor", stroke="#444", width=1.0, points={"show": False}))
        self._legends.append(gui.add_html(""))
        last = spec is plot_specs(self._session.tape.limits)[-1]
        return gui.add_uplot(
            data=plot_data(spec, self._session.tape, 0.0),
            series=(uplot.Series(label="t [s]"), *lines),
            scales={"x": uplot.Scale(time=False)},
            axes=(uplot.Axis(size=24) if last else uplot.Axis(show=False), uplot.Axis(size=38)),
            legend=uplot.Legend(show=True, live=True),
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
            self._scene.show(
                session.tape, t_s, self._choices, None if session.ghost is None else session.ghost.tape, session.ghost_name
            )
        self.updates += 1

    def _show_text(self, t_s: float, end_s: float) -> None:
        session, tape = self._session, self._session.tape
        self._moments.update(session.feed)
        listed = self._moments.listed
        title = session.feed.error or self._opened.title
        self._say(self._state, state_html(tape, t_s, live=session.is_live, title=title, least=self._moments.margin))
        self._say(self._timeline, timeline_html(tape, t_s, None if session.ghost is None else session.ghost_from_s, listed))
        self._say(self._answers, answers_html(self._moments.answers, live=session.is_live))
        self._say(self._transitions, transitions_html(tape, t_s))
        self._say(self._events, events_html(tape, t_s, listed))
        look = tape.look_at(t_s)
        warning = camera_warning(tape, t_s, listed)
        seen, missed = ((), ()) if look is None else self._nosings.judge(look, tape.at(look.t_s))
        reasons = {} if look is None else {number: self._nosings.why_missed(number, look, tape.at(look.t_s)) for number in missed}
        self._say(self._camera, camera_html(look, seen, reasons, warning))
        if self._opened.can_fork:
            self._show_fork()
        if session.attended:
            self._say(self._handset, handset_html(session.handset, tape, t_s))
        note = session.contacts_note if self._choices.contacts else ""
        self._say(self._contacts_note, f'<div style="font-size:12px">{note}</div>')
        self._show_slider(t_s, end_s)

    def _show_fork(self) -> None:
        """Show how far the fork is, and how it went."""
        session, ghost = self._session, self._session.ghost
        self._set(self._drop, "visible", ghost is not None)
        busy = ghost is not None and ghost.worker is not None
        self._set(self._progress, "visible", busy)
        if ghost is None:
            self._say(self._outcome, "")
            return
        self._set(self._drop, "label", "Cancel the fork" if busy else "Remove the fork")
        self._set(self._progress, "value", round(100.0 * min(ghost.tape.end_s / max(session.tape.end_s, 1.0), 1.0), 1))
        margins = ["", ""]
        if ghost.tape.verdict is not None:
            self._ghost_moments.update(ghost)
            margins = [self._ghost_moments.margin, self._moments.margin]
        waited_s = time.perf_counter() - self._forked_at
        self._say(self._outcome, outcome_html(session, waited_s, (margins[0], margins[1])))

    @staticmethod
    def _set(handle: Any, name: str, value: Any) -> None:
        """Set a property of a control, if it has changed."""
        if getattr(handle, name) != value:
            setattr(handle, name, value)

    def _show_slider(self, t_s: float, end_s: float) -> None:
        """Set slider and time box to the cursor; a client that edits them has precedence, and is corrected afterwards."""
        if time.perf_counter() - self._edited_at < EDITED_S:
            self._is_stale = True
            return
        wanted = max(round(end_s, 2), 1.0)
        # A live run grows at every call; its slider follows in steps of half a second.
        if self._slider.max != wanted and (not self._session.is_live or abs(self._slider.max - wanted) > 0.5):
            self._slider.max = wanted
        value = min(round(t_s, 2), self._slider.max)
        if self._is_stale or abs(self._slider.value - value) > 0.005:
            self._is_stale = False
            self._slider.value = value

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
            self._say(legend, legend_html(spec, session.tape, t_s, forked=ghost is not None))
            handle.data = plot_data(spec, session.tape, t_s, ghost)


def vars_of(choices: SceneChoices) -> tuple[bool, ...]:
    """Return the choices as a comparable value."""
    return choices.planes, choices.forces, choices.contacts, choices.swept, choices.follow, choices.passenger


def show_above_sheet(client: Any) -> None:
    """Turn the first view of a narrow screen, whose lower part the panels cover, so that the chair is above them."""
    if client.camera.image_width <= NARROW_PX:
        client.camera.position, client.camera.look_at = NARROW_CAMERA_M, NARROW_LOOK_AT_M


def jump_handler(app: App) -> Callable[[Any], Any]:
    """Return the handler of the page's jumps to the times of its marks."""

    async def serve(connection: Any) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            async for message in connection:
                t_s = float(json.loads(message)["t_s"])
                if math.isfinite(t_s):
                    app.jump(t_s)
        except ConnectionClosed:
            pass
        except (ValueError, TypeError, KeyError):
            await connection.close(1003, "not a time")

    return serve


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
