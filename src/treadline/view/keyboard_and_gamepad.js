// The page's own connection to the viewer: jumps to times, and the handset of keyboard and gamepad.
//
// Anything with data-jump="12.3" leads to this time [s]; data-span="30" spreads its width over as many seconds from there.
// The handset reports ten times a second while a person drives: hold Shift (or a shoulder button of a gamepad) as the dead-man switch,
// and drive with W A S D or the arrow keys (or the left stick). Releasing it, leaving the page, or losing the connection stops the
// chair.
"use strict";
(() => {
  const REPORT_MS = 100, MOVED_PX = 6;
  const KEYS = { KeyW: "up", ArrowUp: "up", KeyS: "down", ArrowDown: "down", KeyA: "left", ArrowLeft: "left", KeyD: "right", ArrowRight: "right" };
  const held = new Set();
  let socket = null, manual = false, pressed = null;

  function connect() {
    const place = window.location.href.split("?")[0].split("#")[0].replace(/\/$/, "").replace(/^http/, "ws");
    socket = new WebSocket(place + "/page");
    socket.onmessage = (message) => { manual = JSON.parse(message.data).manual === true; };
    socket.onclose = () => { socket = null; manual = false; window.setTimeout(connect, 2000); };
  }
  const send = (message) => { if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); };

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

  // A check box that was just clicked has the focus and takes no text.
  const typing = (target) => target instanceof HTMLElement && (target.isContentEditable || ["TEXTAREA", "SELECT"].includes(target.tagName)
    || (target.tagName === "INPUT" && target.type !== "checkbox"));
  const axis = (value) => (Math.abs(value) < 0.15 ? 0 : value);

  function state() {
    const report = { dead_man: held.has("dead_man"), ahead: 0, turn: 0 };
    report.ahead = (held.has("up") ? 1 : 0) - (held.has("down") ? 1 : 0);
    report.turn = (held.has("left") ? 1 : 0) - (held.has("right") ? 1 : 0);
    for (const pad of navigator.getGamepads ? navigator.getGamepads() : []) {
      if (!pad) continue;
      report.dead_man = report.dead_man || [4, 5].some((number) => pad.buttons[number] && pad.buttons[number].pressed);
      report.ahead = report.ahead || -axis(pad.axes[1] || 0);
      report.turn = report.turn || -axis(pad.axes[0] || 0);
    }
    return report;
  }

  document.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && event.target instanceof HTMLElement && event.target.dataset.jump !== undefined) jump(event.target, 0);
    if (!manual || typing(event.target)) return;
    if (event.key === "Shift") held.add("dead_man");
    const name = KEYS[event.code];
    if (name) { held.add(name); event.preventDefault(); event.stopPropagation(); }
  }, true);
  document.addEventListener("keyup", (event) => {
    if (event.key === "Shift") held.delete("dead_man");
    held.delete(KEYS[event.code]);
  }, true);
  window.addEventListener("blur", () => held.clear());
  document.addEventListener("visibilitychange", () => held.clear());
  window.setInterval(() => { if (manual) send(state()); }, REPORT_MS);
  connect();
})();
