// Signals beneath the map: one panel each, all drives in it, under one cursor.

const LEFT = 58;
const RIGHT = 12;
const FOOT = 34;
// Least and largest height of a panel, and of it the line with its title [pixels].
const PANEL = [60, 110];
const HEAD = 16;
// Values beside a panel's title: of so many drives.
const TOLD = 4;

class Panels {
  constructor(base, overlay, signals, seek) {
    Object.assign(this, { base, overlay, signals, dragging: false, height: PANEL[0] });
    const to = (event) => seek(this.cursorAt(event.offsetX));
    overlay.addEventListener("pointerdown", (event) => {
      overlay.setPointerCapture(event.pointerId);
      this.dragging = true;
      to(event);
    });
    overlay.addEventListener("pointermove", (event) => this.dragging && to(event));
    for (const name of ["pointerup", "pointercancel"]) {
      overlay.addEventListener(name, () => (this.dragging = false));
    }
  }

  cursorAt(px) {
    const [low, high] = this.window;
    return low + ((px - LEFT) / Math.max(this.width - LEFT - RIGHT, 1)) * (high - low);
  }

  at(cursor) {
    const [low, high] = this.window;
    return LEFT + ((cursor - low) / Math.max(high - low, 1e-9)) * (this.width - LEFT - RIGHT);
  }

  // The part of the axis that is shown: all of it, or a window that follows the cursor.
  setWindow(state) {
    const [low, high] = state.range;
    if (!(state.span < high - low)) {
      this.window = [low, Math.max(high, low + 0.1)];
      return;
    }
    const from = clamp(state.cursor - state.span / 2, low, high - state.span);
    this.window = [from, from + state.span];
  }

  draw(state, drives) {
    this.setWindow(state);
    const shown = this.signals.filter((signal) => state.shown.has(signal.key));
    const { context, width } = sized(this.base);
    this.width = width;
    this.places = shown.map((signal, k) => this.panel(context, signal, k, state, drives));
    this.foot(context, shown.length, state);
  }

  panel(context, signal, k, state, drives) {
    const top = k * this.height + HEAD;
    const bottom = (k + 1) * this.height - 3;
    const spans = drives.map((drive) => this.rows(drive, state)).filter(Boolean);
    const ranges = spans.map(({ drive, first, last }) => drive.range(signal.key, first, last));
    const [low, high] = padded(Math.min(...ranges.map(([a]) => a)), Math.max(...ranges.map(([, b]) => b)), 5 * signal.step);
    const y = (value) => bottom - ((value - low) / (high - low)) * (bottom - top);
    const { colors, font } = theme;
    context.font = `11px ${font}`;
    context.textAlign = "right";
    context.textBaseline = "middle";
    context.lineWidth = 1;
    const marked = fewTicks(low, high, 3);
    const step = marked.length > 1 ? marked[1] - marked[0] : high - low;
    for (const tick of marked) {
      context.strokeStyle = tick === 0 ? colors.soft : colors.line;
      context.beginPath();
      context.moveTo(LEFT, y(tick));
      context.lineTo(this.width - RIGHT, y(tick));
      context.stroke();
      context.fillStyle = colors.soft;
      context.fillText(tickText(tick, step), LEFT - 6, y(tick));
    }
    context.save();
    context.beginPath();
    context.rect(LEFT, top - 2, this.width - LEFT - RIGHT, bottom - top + 4);
    context.clip();
    for (const span of spans) this.shade(context, span.drive, state, top, bottom);
    for (const span of spans) this.line(context, span, signal.key, state.axis, y);
    context.restore();
    context.fillStyle = colors.ink;
    context.textAlign = "left";
    const title = signal.unit === "-" ? signal.title : `${signal.title} [${signal.unit}]`;
    context.font = `600 12px ${font}`;
    context.fillText(title, LEFT, top - 8);
    return { signal, y, after: LEFT + context.measureText(title).width + 14, head: top - 8 };
  }

  // First and last row of a drive that the window shows.
  rows(drive, state) {
    if (!drive.length || state.hidden.has(drive)) return null;
    const [low, high] = this.window;
    const values = drive[state.axis];
    if (values[0] > high || values[drive.length - 1] < low) return null;
    const first = Math.floor(drive.row(state.axis, low));
    const last = Math.min(Math.ceil(drive.row(state.axis, high)), drive.length - 1);
    return { drive, first, last };
  }

  // A line, or, where rows are denser than pixels, the extremes within each pixel.
  line(context, { drive, first, last }, key, axis, y) {
    const places = drive[axis];
    const values = drive[key];
    const dense = last - first > 3 * this.width;
    context.beginPath();
    context.strokeStyle = drive.color;
    context.lineWidth = 1.6;
    context.lineJoin = "round";
    context.setLineDash(dense ? [] : drive.dash);
    let pen = false;
    for (let i = first; i <= last; i++) {
      const px = this.at(places[i]);
      let low = values[i];
      let high = low;
      if (dense) {
        const column = Math.floor(px);
        while (i < last && Math.floor(this.at(places[i + 1])) === column) {
          i++;
          low = Math.min(low, values[i]);
          high = Math.max(high, values[i]);
        }
      }
      if (!Number.isFinite(low)) {
        pen = false;
        continue;
      }
      if (pen) context.lineTo(px, y(low));
      else context.moveTo(px, y(low));
      if (high !== low) context.lineTo(px, y(high));
      pen = true;
    }
    context.stroke();
    context.setLineDash([]);
    if (first === last) {
      context.fillStyle = drive.color;
      context.fillRect(this.at(places[first]) - 2, y(values[first]) - 2, 4, 4);
    }
  }

  // Where a supervisor or a fallback drove.
  shade(context, drive, state, top, bottom) {
    context.fillStyle = drive.color;
    for (const mark of drive.marks) {
      if (mark.kind !== "fallback" && mark.kind !== "intervention") continue;
      const [from, to] = [mark.row, mark.until].map((row) => this.at(drive[state.axis][row]));
      context.globalAlpha = 0.16;
      context.fillRect(from, top, Math.max(to - from, 2), bottom - top);
    }
    context.globalAlpha = 1;
  }

  foot(context, count, state) {
    const [low, high] = this.window;
    const wanted = clamp(Math.floor(this.width / 90), 3, 12);
    const step = roundStep(high - low, wanted);
    const line = count * this.height;
    context.font = `11px ${theme.font}`;
    context.fillStyle = theme.colors.soft;
    context.textAlign = "center";
    context.textBaseline = "alphabetic";
    for (const tick of ticks(low, high, wanted)) context.fillText(tickText(tick, step), this.at(tick), line + 12);
    const title = state.axis === "time" ? "time [s]" : "distance along the path [m]";
    context.fillText(title, (LEFT + this.width - RIGHT) / 2, line + 27);
  }

  // What moves: the cursor's line, and the values there.
  drawCursor(state, drives) {
    const { context, height } = sized(this.overlay);
    const px = this.at(state.cursor);
    context.lineWidth = 1.5;
    context.strokeStyle = theme.colors.ink;
    context.beginPath();
    context.moveTo(px, 0);
    context.lineTo(px, height - FOOT + 4);
    context.stroke();
    const told = drives.filter((drive) => drive.length && !state.hidden.has(drive)).slice(0, TOLD);
    const rows = told.map((drive) => drive.row(state.axis, state.cursor));
    context.font = `12px ${theme.font}`;
    context.textBaseline = "middle";
    for (const { signal, y, after, head } of this.places) {
      let left = after;
      told.forEach((drive, k) => {
        const value = drive.value(signal.key, rows[k]);
        context.beginPath();
        context.arc(px, y(value), 3, 0, 2 * Math.PI);
        context.fillStyle = drive.color;
        context.fill();
        left = this.tell(context, drive, number(value), left, head, drives.length > 1);
      });
    }
  }

  tell(context, drive, words, left, middle, several) {
    const text = several ? `${drive.number}: ${words}` : words;
    const width = context.measureText(text).width;
    if (left + width + 16 > this.width) return Infinity;
    context.textAlign = "left";
    context.fillStyle = drive.color;
    context.fillRect(left, middle - 4, 8, 8);
    context.fillStyle = theme.colors.ink;
    context.fillText(text, left + 12, middle);
    return left + width + 26;
  }
}

// A range with some air, never empty.
function padded(low, high, least = 1e-6) {
  if (!(high >= low)) return [-1, 1];
  const air = Math.max((high - low) * 0.06, Math.abs(high) * 1e-3, least);
  return [low - air, high + air];
}
