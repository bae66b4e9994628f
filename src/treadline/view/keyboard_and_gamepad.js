// Handset of keyboard and gamepad.
//
// It reports ten times a second while a person drives: hold Shift (or a shoulder button of a gamepad) as the dead-man switch, and drive
// with W A S D or the arrow keys (or the left stick). Releasing it, leaving the page, or losing the connection stops the chair.
"use strict";
(() => {
  const REPORT_MS = 100;
  const KEYS = { KeyW: "up", ArrowUp: "up", KeyS: "down", ArrowDown: "down", KeyA: "left", ArrowLeft: "left", KeyD: "right", ArrowRight: "right" };
  const held = new Set();
  let manual = false;
  window.treadline.listen((said) => { if ("manual" in said) manual = said.manual === true; });  // a message holds what has changed

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
  window.setInterval(() => { if (manual) window.treadline.send(state()); }, REPORT_MS);
})();
