// From metres to pixels: middle, scale and turn of a map, moved by pointers and wheel.

const CLOSEST = 3000; // pixels per metre
const FARTHEST = 0.005;

class View {
  constructor() {
    Object.assign(this, { x: 0, y: 0, scale: 8, turn: 0, width: 1, height: 1 });
  }

  resize(width, height) {
    this.width = Math.max(width, 1);
    this.height = Math.max(height, 1);
  }

  // The matrix of the canvas for points in metres.
  matrix(ratio = 1) {
    const a = this.scale * Math.cos(this.turn);
    const b = -this.scale * Math.sin(this.turn);
    const e = this.width / 2 - a * this.x - b * this.y;
    const f = this.height / 2 - b * this.x + a * this.y;
    return [a, b, b, -a, e, f].map((value) => value * ratio);
  }

  toScreen(x, y) {
    const [a, b, c, d, e, f] = this.matrix();
    return [a * x + c * y + e, b * x + d * y + f];
  }

  toWorld(px, py) {
    const dx = (px - this.width / 2) / this.scale;
    const dy = (this.height / 2 - py) / this.scale;
    const cos = Math.cos(this.turn);
    const sin = Math.sin(this.turn);
    return [this.x + cos * dx + sin * dy, this.y - sin * dx + cos * dy];
  }

  pan(px, py) {
    const [x, y] = this.toWorld(this.width / 2 - px, this.height / 2 - py);
    this.x = x;
    this.y = y;
  }

  // Zoom so that the point under (px, py) stays there.
  zoom(factor, px = this.width / 2, py = this.height / 2) {
    const [x, y] = this.toWorld(px, py);
    this.scale = clamp(this.scale * factor, FARTHEST, CLOSEST);
    const [nx, ny] = this.toWorld(px, py);
    this.x += x - nx;
    this.y += y - ny;
  }

  fit([left, bottom, right, top], margin = 30) {
    this.turn = 0;
    this.x = (left + right) / 2;
    this.y = (bottom + top) / 2;
    const wide = Math.max(this.width - 2 * margin, 20) / Math.max(right - left, 1);
    const high = Math.max(this.height - 2 * margin, 20) / Math.max(top - bottom, 1);
    this.scale = clamp(Math.min(wide, high), FARTHEST, CLOSEST);
  }

  // What can be seen, as a box in metres.
  box() {
    const corners = [[0, 0], [this.width, 0], [0, this.height], [this.width, this.height]];
    const points = corners.map(([px, py]) => this.toWorld(px, py));
    const xs = points.map(([x]) => x);
    const ys = points.map(([, y]) => y);
    return [Math.min(...xs), Math.min(...ys), Math.max(...xs), Math.max(...ys)];
  }
}

// Dragging pans, two fingers and the wheel zoom. The wheel alone scrolls the page, as everywhere
// on it, until the map has the focus.
function moveByPointers(canvas, view, moved) {
  const pointers = new Map();
  const place = (event) => [event.offsetX, event.offsetY];
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const now = place(event);
    if (pointers.size === 1) {
      view.pan(now[0] - before[0], now[1] - before[1]);
      moved("pan");
    } else {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const gap = ([px, py]) => Math.hypot(px - other[0], py - other[1]);
      view.zoom(gap(now) / Math.max(gap(before), 1), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      moved("zoom");
    }
    pointers.set(event.pointerId, now);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  }
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && document.activeElement !== canvas) return;
    event.preventDefault();
    view.zoom(Math.exp(-clamp(event.deltaY, -100, 100) * 0.004), ...place(event));
    moved("zoom");
  }, { passive: false });
}
