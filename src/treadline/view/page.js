// The page's own connection to the viewer, jumps to times, and the timeline at the lower edge over the whole width of the page.
//
// Anything with data-jump="12.3" leads to this time [s]; data-span="30" spreads its width over as many seconds from there.
"use strict";
(() => {
  const MOVED_PX = 6, EDITED_MS = 800;
  const listeners = [], state = {};
  let socket = null, pressed = null, editedAt = -EDITED_MS;

  function connect() {
    const place = window.location.href.split("?")[0].split("#")[0].replace(/\/$/, "").replace(/^http/, "ws");
    socket = new WebSocket(place + "/page");
    socket.onopen = fit;
    socket.onmessage = (message) => { const said = JSON.parse(message.data); for (const listen of listeners) listen(said); };
    socket.onclose = () => { socket = null; for (const listen of listeners) listen({ manual: false }); window.setTimeout(connect, 2000); };
  }
  const send = (message) => { if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };
  const fit = () => send({ width_px: window.innerWidth });
  window.treadline = { send, listen: (listen) => listeners.push(listen) };
  window.addEventListener("resize", fit);

  // ---- jumps ----

  // The panels are rewritten while the run plays, so that a click may begin and end on two elements of the same place.
  const target = (x, y) => { const found = document.elementFromPoint(x, y); return found ? found.closest("[data-jump]") : null; };

  function jump(mark, x) {
    if (!mark) return;
    const { left, width } = mark.getBoundingClientRect();
    const share = mark.dataset.span && width > 0 ? Math.min(Math.max((x - left) / width, 0), 1) * Number(mark.dataset.span) : 0;
    send({ t_s: Number(mark.dataset.jump) + share });
  }
  document.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; }, true);
  document.addEventListener("pointerup", (event) => {
    const from = pressed;
    pressed = null;
    if (!from || Math.hypot(event.clientX - from[0], event.clientY - from[1]) > MOVED_PX) return;
    jump(target(event.clientX, event.clientY), event.clientX);
  }, true);
  document.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && event.target instanceof HTMLElement && event.target.dataset.jump !== undefined) jump(event.target, 0);
  }, true);

  // ---- timeline ----

  const make = (tag, parent, more = {}) => { const made = Object.assign(document.createElement(tag), more); parent.append(made); return made; };
  const bar = make("footer", document.body, { id: "timeline" }), row = make("div", bar, { className: "row" });
  const buttons = make("span", row), time = make("input", row, { type: "text", inputMode: "decimal", ariaLabel: "time [s]" });
  const end = make("span", row), speed = make("select", make("label", row, { textContent: "speed × " }));
  const slider = make("input", bar, { type: "range", min: 0, step: 0.01, ariaLabel: "time" }), phases = make("div", bar);
  const edited = () => { editedAt = performance.now(); };
  const seek = (t_s) => { edited(); send({ t_s }); };
  slider.addEventListener("input", () => seek(Number(slider.value)));
  time.addEventListener("change", () => { const t_s = Number(time.value.replace(",", ".")); if (Number.isFinite(t_s)) seek(t_s); });
  speed.addEventListener("change", () => { edited(); send({ speed: Number(speed.value) }); });

  listeners.push((said) => {
    Object.assign(state, said);
    for (const name of said.buttons && !buttons.children.length ? said.buttons : []) {
      make("button", buttons, { type: "button", textContent: name, onclick: () => send({ press: name }) });
    }
    for (const value of said.speeds && !speed.options.length ? said.speeds : []) speed.append(new Option(String(value), String(value)));
    if (said.timeline !== undefined) phases.innerHTML = said.timeline;
    show();
  });
  /** Show time and speed; a person who edits them has precedence, and is corrected afterwards. */
  function show() {
    if (state.t_s === undefined || performance.now() - editedAt < EDITED_MS) return;
    slider.max = state.end_s;
    slider.value = state.t_s;
    if (document.activeElement !== time) time.value = state.t_s.toFixed(2);
    end.textContent = `s / ${state.end_s.toFixed(1)} s`;
    speed.value = String(state.speed);
    for (const button of buttons.children) button.setAttribute("aria-pressed", String(button.textContent === "play" && state.playing));
  }
  window.setInterval(show, EDITED_MS);
  connect();
})();
