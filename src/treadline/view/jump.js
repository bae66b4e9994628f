// Anything with data-jump="12.3" leads to this time [s]; data-span="30" spreads its width over as many seconds from there.
"use strict";
(() => {
  const MOVED_PX = 6;
  let socket = null;
  let pressed = null;

  function connect() {
    const place = window.location.href.split("?")[0].split("#")[0].replace(/\/$/, "").replace(/^http/, "ws");
    socket = new WebSocket(place + "/jump");
    socket.onclose = () => { socket = null; window.setTimeout(connect, 2000); };
  }

  // The panels are rewritten while the run plays, so that a click may begin and end on two elements of the same place.
  const target = (x, y) => { const found = document.elementFromPoint(x, y); return found ? found.closest("[data-jump]") : null; };

  function jump(mark, x) {
    if (!mark || !socket || socket.readyState !== WebSocket.OPEN) return;
    const { left, width } = mark.getBoundingClientRect();
    const share = mark.dataset.span && width > 0 ? Math.min(Math.max((x - left) / width, 0), 1) * Number(mark.dataset.span) : 0;
    socket.send(JSON.stringify({ t_s: Number(mark.dataset.jump) + share }));
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
  connect();
})();
