// Curves of trainings: small panels side by side, all trainings in each.

const SMALL = { left: 52, right: 10, top: 22, bottom: 34 };

class TrainingPanel {
  constructor(title, index, training, state) {
    Object.assign(this, { title, index, training, state });
    this.canvas = element("canvas", { class: "curve", role: "img", "aria-label": title });
    this.canvas.addEventListener("pointermove", (event) => this.point(event.offsetX));
    this.canvas.addEventListener("pointerleave", () => this.point(null));
  }

  point(px) {
    this.hover = px;
    this.draw();
  }

  lines() {
    return this.training.runs
      .map((run, k) => ({ ...run.panels[this.index], run, k }))
      .filter(({ x, k }) => x.length && !this.state.hidden.has(k));
  }

  draw() {
    const { context, width, height } = sized(this.canvas);
    const lines = this.lines();
    const xs = lines.flatMap((line) => line.x);
    const values = lines.flatMap((line) => [...line.y, ...(line.low || []), ...(line.high || [])]);
    const positive = values.filter((value) => value > 0);
    const log = this.state.log && positive.length > 0;
    const scaled = log ? (value) => (value > 0 ? Math.log10(value) : NaN) : (value) => value;
    const ys = values.map(scaled).filter(Number.isFinite);
    const [x0, x1] = padded(least(xs), most(xs));
    // What never changes is a line in the middle, not one of rounding's size.
    const same = least(ys) === most(ys);
    const [y0, y1] = padded(least(ys), most(ys), same ? Math.max(0.1 * Math.abs(most(ys)), 0.01) : 1e-9);
    const { left, right, top, bottom } = SMALL;
    const px = (x) => left + ((x - x0) / (x1 - x0)) * (width - left - right);
    const py = (y) => height - bottom - ((scaled(y) - y0) / (y1 - y0)) * (height - top - bottom);
    this.frame(context, { width, height, px, py, x0, x1, y0, y1, log });
    for (const line of lines) if (line.low) this.band(context, line, px, py);
    for (const line of lines) this.line(context, line, px, py);
    if (this.hover != null && lines.length) this.tell(context, lines, px, py, width);
  }

  frame(context, { width, height, px, py, x0, x1, y0, y1, log }) {
    const { colors, font } = theme;
    context.font = `11px ${font}`;
    context.strokeStyle = colors.line;
    context.lineWidth = 1;
    context.textBaseline = "middle";
    context.textAlign = "right";
    const step = roundStep(y1 - y0, 4);
    for (const tick of log ? logTicks(y0, y1, 5) : ticks(y0, y1, 4)) {
      context.beginPath();
      context.moveTo(SMALL.left, py(tick));
      context.lineTo(width - SMALL.right, py(tick));
      context.stroke();
      context.fillStyle = colors.soft;
      context.fillText(log ? number(tick, 2) : tickText(tick, step), SMALL.left - 6, py(tick));
    }
    context.textAlign = "center";
    context.fillStyle = colors.soft;
    for (const tick of ticks(x0, x1, 4)) context.fillText(counted(tick, x1), px(tick), height - SMALL.bottom + 10);
    context.fillText(this.training.x, (SMALL.left + width) / 2, height - 8);
    context.fillStyle = colors.ink;
    context.textAlign = "left";
    context.font = `600 12px ${font}`;
    context.fillText(this.title, SMALL.left, 9);
  }

  // From the least to the largest value of several seeds.
  band(context, { x, low, high, run }, px, py) {
    const inside = x.map((_, i) => i).filter((i) => Number.isFinite(py(low[i])) && Number.isFinite(py(high[i])));
    context.beginPath();
    for (const i of inside) context.lineTo(px(x[i]), py(high[i]));
    for (const i of inside.reverse()) context.lineTo(px(x[i]), py(low[i]));
    context.closePath();
    context.globalAlpha = 0.18;
    context.fillStyle = run.color;
    context.fill();
    context.globalAlpha = 1;
  }

  line(context, { x, y, run }, px, py) {
    context.beginPath();
    context.strokeStyle = context.fillStyle = run.color;
    context.lineWidth = 1.6;
    context.setLineDash(DASHES[run.dash] || []);
    let pen = false;
    x.forEach((value, i) => {
      const at = py(y[i]);
      if (!Number.isFinite(at)) pen = false;
      else if (pen) context.lineTo(px(value), at);
      else context.moveTo(px(value), at);
      pen = pen || Number.isFinite(at);
    });
    context.stroke();
    context.setLineDash([]);
    if (x.length > 40) return;
    x.forEach((value, i) => {
      const at = py(y[i]);
      if (Number.isFinite(at)) context.fillRect(px(value) - 2, at - 2, 4, 4);
    });
  }

  // The value nearest to the pointer, of the line nearest to it.
  tell(context, lines, px, py, width) {
    const found = lines.map((line) => {
      const i = line.x.reduce((best, x, k) => (Math.abs(px(x) - this.hover) < Math.abs(px(line.x[best]) - this.hover) ? k : best), 0);
      return { line, i };
    });
    context.textAlign = "right";
    context.font = `11px ${theme.font}`;
    const words = found.slice(0, 3).map(({ line, i }) => number(line.y[i], 4)).join(" · ");
    context.fillStyle = theme.colors.ink;
    const { line, i } = found[0];
    context.fillText(`${number(line.x[i], 5)}: ${words}`, width - SMALL.right, 9);
    for (const each of found) {
      context.beginPath();
      context.arc(px(each.line.x[each.i]), py(each.line.y[each.i]), 3.5, 0, 2 * Math.PI);
      context.fillStyle = each.line.run.color;
      context.fill();
    }
  }
}

// A tick of a long count: in millions or thousands, as its axis' end asks for.
function counted(value, end) {
  const [size, letter] = end >= 1e6 ? [1e6, " M"] : end >= 1e4 ? [1e3, " k"] : [1, ""];
  return value === 0 ? "0" : `${number(value / size, 4)}${letter}`;
}

const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);
const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);

function startTraining(section, training) {
  const state = { log: false, hidden: new Set() };
  const panels = training.panels.map((title, k) => new TrainingPanel(title, k, training, state));
  const redraw = () => panels.forEach((panel) => panel.draw());
  section.querySelector(".curves").append(...panels.map((panel) => panel.canvas));
  section.querySelector(".log").addEventListener("change", (event) => {
    state.log = event.target.checked;
    redraw();
  });
  for (const chip of section.querySelectorAll(".chip")) {
    chip.addEventListener("click", () => {
      const k = Number(chip.dataset.run);
      const shown = state.hidden.delete(k) || !state.hidden.add(k);
      chip.setAttribute("aria-pressed", String(shown));
      redraw();
    });
  }
  theme.listeners.push(redraw);
  new ResizeObserver(redraw).observe(section);
}
