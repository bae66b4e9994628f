"use strict";
// Player of a recorded run: clock, controls, marks in the scene, plots, phases and events.

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const time = data.plots.time, START = time.start, END = time.start + time.step * Math.max(time.count - 1, 0);
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8, 20];
const [PERCEIVED, TRUE, MISSED, ESTIMATE] = ["perceived", "true", "missed", "estimate"].map((sign) =>
  [1, 3, 5].map((k) => parseInt(data.colours[sign].slice(k, k + 2), 16) / 255).concat(0.95));
const player = { t: START, playing: false, speed: 1, follow: true, last: 0, dirty: true };

const poses = data.pose ? { p: unpack(data.pose.p), q: unpack(data.pose.q), joints: unpack(data.pose.joints) } : null;
const signals = unpack(data.heading);  // rows: true heading, estimate, sigma [rad]

/** State of the chair at a time, between the samples. */
function stateAt(t) {
  const f = Math.min(Math.max((t - START) / time.step, 0), time.count - 1), k = Math.min(Math.floor(f), Math.max(time.count - 2, 0)), r = f - k;
  const mixed = (rows, width) => Array.from({ length: width }, (_, i) =>
    rows[width * k + i] * (1 - r) + (k + 1 < time.count ? rows[width * (k + 1) + i] : rows[width * k + i]) * r);
  const p = mixed(poses.p, 3), q = mixed(poses.q, 4), l = Math.hypot(...q), [seat, flipper, left, right] = mixed(poses.joints, 4);
  return { p, q: q.map((x) => x / l), seat, flipper, travel: [left, right] };
}

function lastBefore(list, t, key) {
  let low = 0, high = list.length;
  while (low < high) { const mid = (low + high) >> 1; if (list[mid][key] <= t + 1e-9) low = mid + 1; else high = mid; }
  return low - 1;
}

// ---- marks in the scene ----

function triangle(out, a, b, c, colour) { for (const p of [a, b, c]) out.push(...p, ...colour); }
function ribbon(out, a, b, width, colour) {
  const d = normalised([b[0] - a[0], b[1] - a[1], b[2] - a[2]]);
  const u = normalised(cross(d, Math.abs(d[2]) > 0.9 ? [1, 0, 0] : [0, 0, 1])), v = cross(d, u);
  for (const w of [u, v]) {
    const [p, q, r, s] = [along(a, w, width), along(a, w, -width), along(b, w, width), along(b, w, -width)];
    triangle(out, p, q, r, colour);
    triangle(out, q, s, r, colour);
  }
}
function marksAt(t, state) {
  const out = [], chair = rigid(state.p, state.q), k = Math.min(Math.round((t - START) / time.step), time.count - 1);
  const [truth, estimate, sigma] = [0, 1, 2].map((i) => signals[3 * k + i]);
  const seen = data.maps[lastBefore(data.maps, t, "taken")], fresh = seen && t - seen.taken < 0.5;
  data.nosings.forEach(([right, left], i) => {
    const isMissed = fresh && seen.missed.includes(i), up = [0, 0, isMissed ? 0.02 : 0.012];
    ribbon(out, along(right, up, 1), along(left, up, 1), isMissed ? 0.014 : 0.008, isMissed ? MISSED : TRUE);
  });
  if (fresh) {
    for (const [x, y, z, dx, dy, dz] of seen.points) {
      const p = [x, y, z + 0.012], d = [dx, dy, dz];
      ribbon(out, along(p, d, -0.3), along(p, d, 0.3), 0.011, PERCEIVED);
      ribbon(out, along(p, [0, 0, 1], -0.01), along(p, [0, 0, 1], 0.07), 0.011, PERCEIVED);
    }
  }
  const base = point(chair, [data.reach_m, 0, 0.16]), way = (angle) => direction(chair, [Math.cos(angle), -Math.sin(angle), 0]);
  if (Number.isFinite(truth)) ribbon(out, base, along(base, way(truth), 1.0), 0.006, TRUE);
  if (Number.isFinite(estimate)) {
    const tip = along(base, way(estimate), 0.8), d = way(estimate), side = normalised(cross(d, [0, 0, 1]));
    ribbon(out, base, tip, 0.011, ESTIMATE);
    triangle(out, along(tip, d, 0.13), along(tip, side, 0.055), along(tip, side, -0.055), ESTIMATE);
    for (let i = -4; i < 4; i++) triangle(out, base, along(base, way(estimate + 2 * sigma * i / 4), 0.8), along(base, way(estimate + 2 * sigma * (i + 1) / 4), 0.8), [...ESTIMATE.slice(0, 3), 0.3]);
  }
  return out;
}

// ---- scene ----

let scene = null;
function openScene() {
  const canvas = $("scene");
  if (!poses) {
    $("noscene").textContent = "The log does not place the chair in the world: no scene.";
    $("stage").classList.add("empty");
    document.querySelector(".player").classList.add("unplaced");
    return;
  }
  try {
    scene = new Scene(canvas, data.scene);
  } catch (error) {
    $("noscene").textContent = `The scene is not drawn: this browser has ${error.message}. Plots and events work.`;
    $("stage").classList.add("empty");
    return;
  }
  scene.listen(() => { player.dirty = true; });
  paint();
  view("follow");
}
function paint() {
  if (!scene) return;
  const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
  scene.background = dark ? [0.11, 0.125, 0.145] : [0.93, 0.945, 0.96];
  scene.edgeColour = [0.12, 0.14, 0.17];
  player.dirty = true;
}
const VIEWS = {  // azimuth, elevation [rad], distance [m]
  follow: [-1.95, 0.3, 4.4], side: [-Math.PI / 2, 0, 4.6], behind: [Math.PI, 0, 4.4], top: [-Math.PI / 2, Math.PI / 2, 5.2], whole: [-1.75, 0.22, 1],
};
function view(name) {
  if (!scene) return;
  const v = scene.view, { low, high } = data.extent;
  v.pan = [0, 0, 0];
  player.follow = name !== "whole";
  [v.azimuth, v.elevation, v.distance] = VIEWS[name];
  v.orthogonal = ["side", "behind", "top"].includes(name);
  if (name === "whole") {
    v.target = low.map((x, i) => (x + high[i]) / 2);
    v.distance = 1.04 * scene.distanceFor(low, high);
  } else {  // a narrow canvas shows less to the sides
    v.distance *= Math.max(1, 1.25 / (scene.canvas.clientWidth / Math.max(scene.canvas.clientHeight, 1)));
  }
  player.view = name;
  player.dirty = true;
}

// ---- camera image ----

const shot = { index: -1, image: new Image() };
shot.image.onload = () => drawShot();
function drawShot() {
  const canvas = $("camera"), g = canvas.getContext("2d"), item = data.images[shot.index];
  canvas.width = shot.image.naturalWidth;
  canvas.height = shot.image.naturalHeight;
  g.drawImage(shot.image, 0, 0);
  g.strokeStyle = data.colours.perceived;
  g.lineWidth = 2;
  for (const [x0, y0, x1, y1] of item.lines) { g.beginPath(); g.moveTo(x0 * canvas.width, y0 * canvas.height); g.lineTo(x1 * canvas.width, y1 * canvas.height); g.stroke(); }
  $("cameranote").textContent = `camera image of ${item.t.toFixed(2)} s, ${item.lines.length ? `${item.lines.length} perceived nosings` : "no stair perceived"}`;
}
function showShot(t) {
  if (!data.images.length) return;
  const k = Math.max(lastBefore(data.images, t, "t"), 0);
  if (k === shot.index) return;
  shot.index = k;
  shot.image.src = `data:image/jpeg;base64,${data.images[k].jpeg}`;
}

// ---- phases and events ----

const tips = Object.fromEntries(Object.entries(data.terms).flatMap(([name, term]) => term.labels.map((label) => [label, `${name}: ${term.text}`])));
function explain(element, label) { if (tips[label]) element.title = tips[label]; }
/** Explanations of the terms that occur in a text. */
function explained(text) {
  const found = Object.entries(data.terms).filter(([name]) => name.split(", ").some((word) => text.includes(word)));
  return found.map(([name, term]) => `${name}: ${term.text}`).join("\n");
}
for (const item of document.querySelectorAll(".legend span")) explain(item, item.textContent);
for (const [name, term] of [...Object.entries(data.terms).map(([n, t]) => [n, t.text]), ...Object.entries(data.phase_terms).map(([n, t]) => [`phase ${n}`, t])]) {
  const dt = document.createElement("dt"), dd = document.createElement("dd");
  dt.textContent = name;
  dd.textContent = term;
  document.querySelector("#terms dl").append(dt, dd);
}
function markButton(host, className, from, title) {
  const b = document.createElement("button");
  b.type = "button";
  b.className = className;
  b.title = title;
  b.setAttribute("aria-label", title);
  b.addEventListener("click", () => seek(from));
  host.append(b);
  return b;
}
const phaseButtons = data.plots.bands.map((band, k) => {
  const meaning = data.phase_terms[band.name] ? ` (${data.phase_terms[band.name]})` : "";
  const b = markButton($("phases"), k % 2 ? "odd" : "even", band.start, `${band.name}${meaning} from ${band.start.toFixed(2)} s: ${band.cause || "start"}`);
  b.textContent = band.name;
  if (band.colour) b.style.borderBottom = `.25rem solid ${band.colour}`;
  return { b, start: band.start, end: band.end, name: band.name };
});
// Holds and faults lie over the phases.
const spans = [
  ...data.events.filter((event) => event.kind === "fault").map((event) => ["fault", event.t, event.end, event.cause]),
  ...data.holds.map((hold) => ["hold", hold.start, hold.end, `hold: ${hold.cause}`]),
];
const phaseMarks = spans.map(([kind, start, end, title]) => ({ b: markButton($("phases"), kind, start, `${start.toFixed(2)} s ${title}`), start, end, name: "" }));
function placePhases([a, b]) {
  const strip = $("phases").clientWidth;
  for (const item of [...phaseButtons, ...phaseMarks]) {
    const from = Math.max((item.start - a) / (b - a), 0), to = Math.min((item.end - a) / (b - a), 1), isMark = !item.name;
    item.b.hidden = to < from || (to === from && !isMark) || item.start > b || item.end < a;
    item.b.style.left = isMark ? `min(${100 * from}%, 100% - 5px)` : `${100 * from}%`;
    item.b.style.width = `${100 * Math.max(to - from, 0)}%`;
    // A name that does not fit is left out; the tooltip has it.
    if (!isMark) item.b.textContent = (to - from) * strip > 7.2 * item.name.length + 8 ? item.name : "";
  }
}
for (const [kind, start, end, title] of [
  ...data.events.filter((event) => ["motion", "perception"].includes(event.kind)).map((event) => [event.kind, event.t, event.kind === "motion" ? event.t : event.end, `${event.name}: ${event.cause}`]),
  ...data.missed.map((frame) => ["missed", frame.t, frame.t, `nosing ${frame.numbers} missed`]),
  ...spans,
]) {
  const mark = markButton($("marks"), kind, start, `${start.toFixed(2)} s ${title}`), whole = Math.max(END - START, 1e-9);
  mark.style.left = `min(${100 * (start - START) / whole}%, 100% - 4px)`;
  mark.style.width = `${100 * (end - start) / whole}%`;
  mark.tabIndex = -1;  // the list of events has them all
}
const rows = data.events.map((event) => {
  const tr = document.createElement("tr"), b = document.createElement("button");
  tr.className = event.name === "hold" ? "hold" : event.kind;
  b.type = "button";
  b.textContent = `${event.t.toFixed(2)} s`;
  b.addEventListener("click", () => seek(event.t));
  const cells = [b, event.name, event.cause].map((value) => { const td = document.createElement("td"); td.append(value); return td; });
  cells[1].title = data.phase_terms[event.name] || explained(event.name);
  cells[2].title = explained(event.cause);
  tr.append(...cells);
  $("events").append(tr);
  return tr;
});
for (const moment of data.moments) {
  const b = document.createElement(moment.t === null ? "span" : "button");
  if (moment.t !== null) {
    b.type = "button";
    b.addEventListener("click", () => seek(moment.t));
  }
  b.className = moment.kind;
  b.textContent = moment.label;
  b.title = [moment.note, explained(moment.label)].filter(Boolean).join("\n");
  $("moments").append(b);
}

// ---- plots ----

for (const panel of data.plots.panels) for (const curve of panel.curves) {
  curve.values = unpack(data.plots.series[curve.series]);
  if (curve.sigma) curve.band = unpack(data.plots.series[curve.sigma]);
}
const plots = new Plots($("plots"), time, data.plots.panels, data.plots.bands, (t, pressed) => { if (pressed) seek(t); });
plots.onwindow = placePhases;
for (const item of document.querySelectorAll(".panel .head strong, .panel .key")) explain(item, (item.firstChild.textContent || "").replace(/ \[.*/, ""));
placePhases(plots.window);

// ---- clock and controls ----

function seek(t) {
  player.t = Math.min(Math.max(t, START), END);
  player.dirty = true;
}
function play(on) {
  player.playing = on;
  if (on && player.t >= END - 1e-9) player.t = START;
  player.last = 0;
  $("play").textContent = on ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", on ? "Pause" : "Play");
  player.dirty = true;
}
function setSpeed(value) { player.speed = value; $("speed").value = String(value); }
function step(n) { play(false); seek(START + time.step * (Math.round((player.t - START) / time.step) + n)); }
function phaseStep(sign) {
  const starts = data.plots.bands.map((band) => band.start);
  const to = sign > 0 ? starts.find((s) => s > player.t + 1e-6) : [...starts].reverse().find((s) => s < player.t - 0.3);
  seek(to === undefined ? (sign > 0 ? END : START) : to);
}
for (const value of SPEEDS) $("speed").append(new Option(`${value}×`, String(value)));
setSpeed(1);
$("slider").min = START;
$("slider").max = END;
$("slider").step = time.step;
$("slider").addEventListener("input", () => seek(Number($("slider").value)));
$("play").addEventListener("click", () => play(!player.playing));
$("back").addEventListener("click", () => step(-1));
$("forth").addEventListener("click", () => step(1));
$("before").addEventListener("click", () => phaseStep(-1));
$("after").addEventListener("click", () => phaseStep(1));
$("speed").addEventListener("change", () => setSpeed(Number($("speed").value)));
$("zoomin").addEventListener("click", () => plots.zoom(0.5, player.t));
$("zoomout").addEventListener("click", () => plots.zoom(2, player.t));
$("zoomfirst").hidden = !data.transient_s;
$("zoomfirst").addEventListener("click", () => { plots.show(START, data.transient_s); seek(START); });
$("zoomall").addEventListener("click", () => plots.show(START, END));
for (const b of document.querySelectorAll("[data-view]")) b.addEventListener("click", () => view(b.dataset.view));
// A finger has no hover: a tap on a term shows its explanation until the next tap.
document.addEventListener("pointerup", (e) => {
  const item = e.pointerType === "mouse" ? null : e.target.closest('[title]:not([title=""], button)');
  $("tip").hidden = !item || $("tip").textContent === item.title && !$("tip").hidden;
  if (item) $("tip").textContent = item.title;
});
// After a click the space bar plays; a button that the keyboard has reached keeps it.
document.addEventListener("click", (e) => { const b = e.target.closest("button"); if (b && e.detail) b.blur(); });
document.addEventListener("keydown", (e) => {
  if (e.target.tagName === "SELECT" || e.ctrlKey || e.metaKey || e.altKey) return;
  if (e.target.tagName === "BUTTON" && e.key === " ") return;
  const faster = SPEEDS.indexOf(player.speed);
  const keys = {
    " ": () => play(!player.playing), ArrowLeft: () => seek(player.t - 0.5), ArrowRight: () => seek(player.t + 0.5),
    ",": () => step(-1), ".": () => step(1), ArrowUp: () => setSpeed(SPEEDS[Math.min(faster + 1, SPEEDS.length - 1)]),
    ArrowDown: () => setSpeed(SPEEDS[Math.max(faster - 1, 0)]), Home: () => seek(START), End: () => seek(END),
    PageDown: () => phaseStep(1), PageUp: () => phaseStep(-1),
  };
  if (!(e.key in keys)) return;
  e.preventDefault();
  keys[e.key]();
});

function holdAt(t) { return data.holds.find((hold) => hold.start <= t + 1e-6 && (t < hold.end || hold.end >= END - 1e-6)); }
/** Name of the view as it was chosen, or null once the scene has been turned. */
function shownView() {
  const v = scene && scene.view, chosen = VIEWS[player.view];
  return v && chosen && v.azimuth === chosen[0] && v.elevation === chosen[1] ? player.view : null;
}
/** What the camera perceives, or since when it perceives nothing. */
function seenAt(t) {
  if (!data.maps.length) return "";
  const spans = data.events.filter((event) => event.kind === "perception" && event.t < t && t <= event.end);
  const seen = data.maps[lastBefore(data.maps, t, "taken")];
  if (seen && t - seen.taken < 0.5) return seen.text;
  return spans.length ? `${spans[0].name} ${spans[0].cause}` : "no stair perceived";
}
function refresh() {
  const t = player.t;
  if (scene) {
    const state = stateAt(t);
    if (player.follow) scene.view.target = along(state.p, [0, 0, 1], 0.62);
    scene.draw(state, marksAt(t, state));
  }
  $("slider").value = t;
  $("clock").textContent = `${t.toFixed(2)} / ${END.toFixed(2)} s`;
  plots.setCursor(t);
  const band = data.plots.bands[lastBefore(data.plots.bands, t, "start")];
  const hold = holdAt(t);
  $("phase").textContent = hold ? "HOLD" : band ? band.name : "";
  $("phase").classList.toggle("holds", Boolean(hold));
  $("why").textContent = hold ? `${band ? `during ${band.name}` : ""}: ${hold.cause}` : band && band.cause ? `because ${band.cause}` : "";
  const faults = data.events.filter((event) => event.kind === "fault" && event.t <= t && t <= event.end);
  $("why").title = explained($("why").textContent);
  $("chain").textContent = hold ? hold.chain : faults.map((fault) => `fault since ${fault.t.toFixed(2)} s: ${fault.cause}`).join("; ");
  $("phase").title = hold ? data.terms.hold.text : band && data.phase_terms[band.name] || "";
  phaseButtons.forEach((item, k) => item.b.classList.toggle("now", data.plots.bands[k] === band));
  for (const b of document.querySelectorAll("[data-view]")) b.setAttribute("aria-pressed", String(b.dataset.view === shownView()));
  const now = lastBefore(data.events, t, "t");
  rows.forEach((row, k) => row.classList.toggle("now", k === now));
  if (now >= 0 && now !== player.event) {
    player.event = now;
    const box = $("eventbox"), row = rows[now], top = row.offsetTop, bottom = top + row.offsetHeight;
    if (top < box.scrollTop + 60) box.scrollTop = top - 60;
    if (bottom > box.scrollTop + box.clientHeight) box.scrollTop = bottom - box.clientHeight;
  }
  $("sees").textContent = seenAt(t);
  showShot(t);
}
function frame(now) {
  if (player.playing) {
    if (player.last) player.t += player.speed * (now - player.last) / 1000;
    player.last = now;
    player.dirty = true;
    if (player.t >= END) { player.t = END; play(false); }
  }
  if (player.dirty) { player.dirty = false; refresh(); }
  requestAnimationFrame(frame);
}
$("camerabox").hidden = !data.images.length;
openScene();
window.addEventListener("resize", () => { placePhases(plots.window); player.dirty = true; });
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paint);
function follow() {
  const asked = /^#t=([0-9.]+)$/.exec(location.hash);
  if (!asked) return;
  seek(Number(asked[1]));
  document.querySelector(".player").scrollIntoView();
}
window.addEventListener("hashchange", follow);
if (data.transient_s) plots.show(START, data.transient_s);
follow();
requestAnimationFrame(frame);
