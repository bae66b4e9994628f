"use strict";
// Time series in panels with one time axis: hover values, zoom, limits, bands, and a cursor that all panels share.

const MARGIN = { left: 46, right: 8, top: 6, bottom: 6 }, AXIS_PX = 20;
const SWIPE_PX = 8;  // below, a finger that taps has not moved

function css(name) { return getComputedStyle(document.documentElement).getPropertyValue(name).trim(); }

/** Round step of an axis with at most `most` ticks. */
function tickStep(span, most) {
  const rough = span / most, decade = 10 ** Math.floor(Math.log10(rough));
  return decade * [1, 2, 5, 10].find((k) => k * decade >= rough * 0.999);
}
function ticksOf(low, high, most) {
  const step = tickStep(high - low, most), found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}
function shownNumber(value, digits) {
  const text = Number.isFinite(value) ? value.toFixed(digits) : "–";
  return /^-0[.0]*$/.test(text) ? text.slice(1) : text;
}

class Plots {
  /** panels: [{title, unit, digits, height, curves: [{label, colour, values, band?}], limits: [{value, label, spans?}], zero?}];
   *  time: {start, step, count}; bands: [{start, end, name}] are drawn as a background. */
  constructor(host, time, panels, bands, seek) {
    this.host = host;
    this.time = time;
    this.bands = bands;
    this.seek = seek;
    this.end = time.start + time.step * Math.max(time.count - 1, 0);
    this.window = [time.start, Math.max(this.end, time.start + time.step)];
    this.cursor = null;
    this.panels = panels.map((panel, k) => this.panel(panel, k === panels.length - 1));
    new ResizeObserver(() => this.redraw()).observe(host);
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
  }
  panel(panel, last) {
    const box = document.createElement("div"), head = document.createElement("div"), canvas = document.createElement("canvas");
    box.className = "panel";
    head.className = "head";
    const title = document.createElement("strong");
    title.textContent = panel.title + (panel.unit ? ` [${panel.unit}]` : "");
    head.append(title);
    const values = panel.curves.map((curve) => {
      const item = document.createElement("span"), value = document.createElement("b");
      item.className = "key";
      item.style.setProperty("--key", `var(${curve.colour})`);
      item.append(curve.label, value);
      head.append(item);
      return value;
    });
    for (const limit of panel.limits || []) {
      const item = document.createElement("span");
      item.className = "limit";
      item.textContent = limit.label;
      head.append(item);
    }
    canvas.style.height = `${(panel.height || 96) + (last ? AXIS_PX : 0)}px`;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", this.described(panel));
    box.append(head, canvas);
    this.host.append(box);
    const made = { ...panel, canvas, values, last, still: document.createElement("canvas") };
    this.listen(canvas);
    return made;
  }
  /** Text alternative of a panel: range of each curve. */
  described(panel) {
    const ranges = panel.curves.map((curve) => {
      let low = Infinity, high = -Infinity;
      for (const value of curve.values) if (Number.isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
      return low <= high ? `${curve.label || panel.title} from ${low.toFixed(2)} to ${high.toFixed(2)}` : `${curve.label}: no data`;
    });
    return `${panel.title}${panel.unit ? ` in ${panel.unit}` : ""} over time: ${ranges.join("; ")}`;
  }
  listen(canvas) {
    const timeAt = (e) => {
      const box = canvas.getBoundingClientRect(), f = (e.clientX - box.left - MARGIN.left) / (box.width - MARGIN.left - MARGIN.right);
      return this.window[0] + Math.min(Math.max(f, 0), 1) * (this.window[1] - this.window[0]);
    };
    // A finger moves the time only once its drag is horizontal, or with a tap: a vertical swipe scrolls the page (touch-action).
    let down = false, touched = null;
    canvas.addEventListener("pointerdown", (e) => {
      if (e.pointerType === "touch") { touched = [e.clientX, e.clientY]; return; }
      down = true;
      canvas.setPointerCapture(e.pointerId);
      this.seek(timeAt(e), true);
    });
    canvas.addEventListener("pointermove", (e) => {
      if (touched && !down) {
        const dx = Math.abs(e.clientX - touched[0]), dy = Math.abs(e.clientY - touched[1]);
        if (dy > SWIPE_PX && dy >= dx) touched = null;
        else if (dx > SWIPE_PX) { down = true; canvas.setPointerCapture(e.pointerId); }
      }
      if (down || e.pointerType === "mouse") this.seek(timeAt(e), down);
    });
    canvas.addEventListener("pointerup", (e) => { if (touched) this.seek(timeAt(e), true); down = false; touched = null; });
    canvas.addEventListener("pointercancel", () => { down = false; touched = null; });
    canvas.addEventListener("wheel", (e) => {
      if (!e.ctrlKey && !e.shiftKey) return;  // the page scrolls
      e.preventDefault();
      this.zoom(Math.exp(0.002 * (e.deltaY || e.deltaX)), timeAt(e));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => this.show(this.time.start, this.end));
  }
  zoom(factor, around) {
    const [a, b] = this.window, at = around === undefined ? (this.cursor === null ? (a + b) / 2 : this.cursor) : around;
    const span = Math.min(Math.max((b - a) * factor, 20 * this.time.step), this.end - this.time.start);
    const share = Math.min(Math.max((at - a) / (b - a), 0), 1);
    const start = Math.min(Math.max(at - share * span, this.time.start), Math.max(this.end - span, this.time.start));
    this.show(start, start + span);
  }
  show(start, end) {
    this.window = [start, Math.max(end, start + this.time.step)];
    this.redraw();
    if (this.onwindow) this.onwindow(this.window);
  }
  index(t) { return Math.min(Math.max(Math.floor((t - this.time.start) / this.time.step + 1e-6), 0), this.time.count - 1); }
  setCursor(t) {
    this.cursor = t;
    const [a, b] = this.window;
    if (t !== null && (t < a || t > b)) {
      const span = b - a, start = Math.min(Math.max(t - 0.1 * span, this.time.start), Math.max(this.end - span, this.time.start));
      this.show(start, start + span);
    }
    for (const panel of this.panels) this.drawCursor(panel);
  }
  redraw() { for (const panel of this.panels) { this.drawStill(panel); this.drawCursor(panel); } }
  x(t, width) { return MARGIN.left + (t - this.window[0]) / (this.window[1] - this.window[0]) * (width - MARGIN.left - MARGIN.right); }
  range(panel) {
    const i0 = this.index(this.window[0]), i1 = this.index(this.window[1]);
    let low = Infinity, high = -Infinity;
    for (const curve of panel.curves) for (let i = i0; i <= i1; i++) {
      const v = curve.values[i], s = curve.band ? curve.band[i] || 0 : 0;
      if (Number.isFinite(v)) { low = Math.min(low, v - s); high = Math.max(high, v + s); }
    }
    if (!(low <= high)) return [0, 1];
    if (panel.zero) { low = Math.min(low, 0); high = Math.max(high, 0); }
    const reach = Math.max(Math.abs(low), Math.abs(high), 1e-6);
    for (const limit of panel.limits || []) if (limit.always || Math.abs(limit.value) <= 1.6 * reach) {
      low = Math.min(low, limit.value);
      high = Math.max(high, limit.value);
    }
    const spare = Math.max((panel.least_span || 0) - (high - low), 0);
    if (low >= 0) high += spare; else { low -= spare / 2; high += spare / 2; }
    const room = Math.max(0.06 * (high - low), 0.02 * reach, 1e-6);
    return [low - room, high + room];
  }
  drawStill(panel) {
    const scale = Math.min(window.devicePixelRatio || 1, 2), w = panel.canvas.clientWidth, h = panel.canvas.clientHeight;
    if (!w) return;
    for (const c of [panel.still, panel.canvas]) { c.width = Math.round(w * scale); c.height = Math.round(h * scale); }
    const g = panel.still.getContext("2d"), bottom = h - MARGIN.bottom - (panel.last ? AXIS_PX : 0), top = MARGIN.top;
    g.scale(scale, scale);
    const [low, high] = this.range(panel), y = (v) => bottom - (v - low) / (high - low) * (bottom - top);
    this.bands.forEach((band, k) => {
      const a = Math.max(this.x(band.start, w), MARGIN.left), b = Math.min(this.x(band.end, w), w - MARGIN.right);
      if (b <= a) return;
      g.fillStyle = css(k % 2 ? "--band-b" : "--band-a");
      g.fillRect(a, top, b - a, bottom - top);
    });
    g.font = "11px system-ui, sans-serif";
    g.lineWidth = 1;
    g.fillStyle = css("--quiet");
    g.strokeStyle = css("--line");
    const [vertical, digits] = ticksOf(low, high, 4);
    g.textAlign = "right";
    g.textBaseline = "middle";
    for (const v of vertical) {
      g.beginPath();
      g.moveTo(MARGIN.left, y(v));
      g.lineTo(w - MARGIN.right, y(v));
      g.stroke();
      g.fillText(v.toFixed(digits), MARGIN.left - 5, y(v));
    }
    const [across, decimals] = ticksOf(...this.window, Math.max(3, Math.floor(w / 90)));
    g.textAlign = "center";
    g.textBaseline = "top";
    for (const t of across) {
      g.beginPath();
      g.moveTo(this.x(t, w), top);
      g.lineTo(this.x(t, w), bottom);
      g.stroke();
      if (!panel.last) continue;
      const text = `${t.toFixed(decimals)} s`, half = 0.5 * g.measureText(text).width;
      g.fillText(text, Math.min(Math.max(this.x(t, w), half), w - half), bottom + 6);
    }
    g.save();
    g.beginPath();
    g.rect(MARGIN.left, top - 1, w - MARGIN.left - MARGIN.right, bottom - top + 2);
    g.clip();
    for (const limit of panel.limits || []) {
      g.strokeStyle = css("--sign-limit");
      g.setLineDash([5, 4]);
      g.beginPath();
      for (const [start, end] of limit.spans || [this.window]) {
        g.moveTo(Math.max(this.x(start, w), MARGIN.left), y(limit.value));
        g.lineTo(Math.min(this.x(end, w), w - MARGIN.right), y(limit.value));
      }
      g.stroke();
      g.setLineDash([]);
    }
    for (const curve of panel.curves) {
      if (curve.band) this.drawBand(g, curve, w, y);
      this.drawCurve(g, curve, w, y);
    }
    g.restore();
  }
  /** Draw a curve: line between samples, or the span of the samples of each pixel where they are dense. */
  drawCurve(g, curve, w, y) {
    const i0 = Math.max(this.index(this.window[0]) - 1, 0), i1 = Math.min(this.index(this.window[1]) + 1, this.time.count - 1);
    const every = Math.max(1, Math.floor((i1 - i0) / Math.max(w, 1)));
    g.strokeStyle = css(curve.colour);
    g.lineWidth = 1.4;
    if (curve.dash) g.setLineDash(curve.dash);
    g.beginPath();
    let open = false;
    for (let i = i0; i <= i1; i += every) {
      let low = Infinity, high = -Infinity;
      for (let j = i; j < Math.min(i + every, i1 + 1); j++) {
        const v = curve.values[j];
        if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); }
      }
      if (!(low <= high)) { open = false; continue; }
      const x = this.x(this.time.start + i * this.time.step, w);
      if (open) g.lineTo(x, y(low)); else g.moveTo(x, y(low));
      if (high > low) g.lineTo(x, y(high));
      open = true;
    }
    g.stroke();
    g.setLineDash([]);
  }
  drawBand(g, curve, w, y) {
    const i0 = this.index(this.window[0]), i1 = this.index(this.window[1]), every = Math.max(1, Math.floor((i1 - i0) / Math.max(w, 1)));
    const upper = [], lower = [];
    for (let i = i0; i <= i1; i += every) {
      const v = curve.values[i], s = curve.band[i];
      if (!Number.isFinite(v) || !Number.isFinite(s)) continue;
      const x = this.x(this.time.start + i * this.time.step, w);
      upper.push([x, y(v + s)]);
      lower.unshift([x, y(v - s)]);
    }
    if (!upper.length) return;
    g.fillStyle = css(curve.colour);
    g.globalAlpha = 0.22;
    g.beginPath();
    [...upper, ...lower].forEach(([px, py], k) => (k ? g.lineTo(px, py) : g.moveTo(px, py)));
    g.fill();
    g.globalAlpha = 1;
  }
  drawCursor(panel) {
    const g = panel.canvas.getContext("2d"), w = panel.canvas.clientWidth, h = panel.canvas.clientHeight;
    if (!w || !panel.still.width) return;
    const scale = panel.canvas.width / w;
    g.setTransform(1, 0, 0, 1, 0, 0);
    g.clearRect(0, 0, panel.canvas.width, panel.canvas.height);
    g.drawImage(panel.still, 0, 0);
    if (this.cursor === null) return;
    g.setTransform(scale, 0, 0, scale, 0, 0);
    const x = this.x(this.cursor, w), i = this.index(this.cursor);
    g.strokeStyle = css("--ink");
    g.lineWidth = 1.2;
    g.beginPath();
    g.moveTo(x, MARGIN.top);
    g.lineTo(x, h - MARGIN.bottom - (panel.last ? AXIS_PX : 0));
    g.stroke();
    panel.curves.forEach((curve, k) => {
      const v = curve.values[i], s = curve.band ? curve.band[i] : NaN, digits = panel.digits === undefined ? 2 : panel.digits;
      panel.values[k].textContent = ` ${shownNumber(v, digits)}${Number.isFinite(s) ? ` ± ${shownNumber(s, digits)}` : ""}`;
    });
  }
}
