// The map: ground, road with its corridor, driven lines, waypoints, marks, cars.

// Rows of one piece of a line; pieces out of sight are not drawn.
const PIECE = 400;

class Line {
  constructor(drive, magnify) {
    this.drive = drive;
    this.points = new Float64Array(2 * drive.length);
    for (let i = 0; i < drive.length; i++) {
      const { x, y } = drive.pose(i, magnify);
      this.points[2 * i] = x;
      this.points[2 * i + 1] = y;
    }
    this.pieces = [];
    for (let from = 0; from < drive.length - 1; from += PIECE) {
      const to = Math.min(from + PIECE, drive.length - 1);
      this.pieces.push({ from, to, path: this.path(from, to), box: this.box(from, to) });
    }
  }

  path(from, to) {
    const path = new Path2D();
    path.moveTo(this.points[2 * from], this.points[2 * from + 1]);
    for (let i = from + 1; i <= to; i++) path.lineTo(this.points[2 * i], this.points[2 * i + 1]);
    return path;
  }

  box(from, to) {
    return boxOf(this.points.subarray(2 * from, 2 * to + 2));
  }
}

function boxOf(points) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (let i = 0; i + 1 < points.length; i += 2) {
    if (!Number.isFinite(points[i] + points[i + 1])) continue;
    box[0] = Math.min(box[0], points[i]);
    box[1] = Math.min(box[1], points[i + 1]);
    box[2] = Math.max(box[2], points[i]);
    box[3] = Math.max(box[3], points[i + 1]);
  }
  return box[0] <= box[2] ? box : [-5, -5, 5, 5];
}

const apart = (a, b) => a[0] > b[2] || a[2] < b[0] || a[1] > b[3] || a[3] < b[1];

class RoadMap {
  constructor(group, drives, columns) {
    this.half = group.half;
    this.drives = drives;
    const [xs, ys] = group.road.map((entry) => columns.read(entry));
    this.road = new Path2D();
    const points = new Float64Array(2 * xs.length);
    for (let i = 0; i < xs.length; i++) {
      points.set([xs[i], ys[i]], 2 * i);
      if (i) this.road.lineTo(xs[i], ys[i]);
      else this.road.moveTo(xs[i], ys[i]);
    }
    this.start = xs.length ? [xs[0], ys[0], xs[1], ys[1]] : null;
    const box = boxOf(points);
    this.box = [box[0] - this.half, box[1] - this.half, box[2] + this.half, box[3] + this.half];
    this.magnify(1);
  }

  magnify(factor) {
    this.factor = factor;
    this.lines = this.drives.map((drive) => new Line(drive, factor));
  }

  draw(canvas, view, state) {
    const { context, width, height, ratio } = sized(canvas);
    view.resize(width, height);
    context.fillStyle = theme.colors.ground;
    context.fillRect(0, 0, width, height);
    grid(context, view);
    drawRoad(context, view, ratio, this);
    const shown = this.drives.filter((drive) => !state.hidden.has(drive) && drive.length);
    const rows = new Map(shown.map((drive) => [drive, drive.row(state.axis, state.cursor)]));
    for (const drive of shown) this.drawLine(context, view, ratio, drive, rows.get(drive));
    for (const drive of shown) this.drawMarks(context, view, drive);
    const order = shown.filter((drive) => drive !== state.lead).concat(shown.includes(state.lead) ? [state.lead] : []);
    for (const drive of order) this.drawDrive(context, view, ratio, drive, rows.get(drive), state);
    for (const drive of order) this.drawBadge(context, view, drive, rows.get(drive));
    scaleBar(context, view);
    if (this.factor !== 1) {
      context.textAlign = "left";
      context.font = `600 12px ${theme.font}`;
      context.fillText(`lateral errors drawn ×${this.factor}`, 12, 20);
    }
  }

  drawLine(context, view, ratio, drive, row) {
    const line = this.lines[this.drives.indexOf(drive)];
    const seen = view.box();
    const now = Math.floor(row);
    context.save();
    context.setTransform(...view.matrix(ratio));
    context.strokeStyle = drive.color;
    context.lineCap = drive.dash.length ? "butt" : "round";
    context.lineJoin = "round";
    const pixel = 1 / view.scale;
    context.setLineDash(drive.dash.map((length) => 1.6 * length * pixel));
    const stroke = (path, driven) => {
      context.globalAlpha = driven ? 1 : 0.4;
      context.lineWidth = (driven ? 2.6 : 1.4) * pixel;
      context.stroke(path);
    };
    for (const piece of line.pieces) {
      if (apart(piece.box, seen)) continue;
      if (now >= piece.to || now <= piece.from) {
        stroke(piece.path, now >= piece.to);
      } else {
        stroke(line.path(piece.from, now), true);
        stroke(line.path(now, piece.to), false);
      }
    }
    context.restore();
  }

  drawMarks(context, view, drive) {
    for (const mark of drive.marks) {
      if (mark.kind === "saturated" && view.scale < 2) continue;
      const { x, y } = drive.pose(mark.row, this.factor);
      const [px, py] = view.toScreen(x, y);
      if (px > -20 && py > -20 && px < view.width + 20 && py < view.height + 20) {
        drawGlyph(context, mark.kind, px, py, 6, drive.color);
      }
    }
  }

  drawDrive(context, view, ratio, drive, row, state) {
    const pose = drive.pose(row, this.factor);
    if (view.scale > 2) {
      context.globalAlpha = drive === state.lead ? 1 : 0.4;
      for (const [x, y] of drive.waypoints(row)) drawWaypoint(context, ...view.toScreen(x, y), drive);
    }
    const over = drive.over(state.axis, state.cursor);
    drawCar(context, view, drive, pose, ratio, drive === state.lead ? 0.85 : 0.5);
    context.globalAlpha = 1;
    if (!over) drawVelocity(context, view, pose);
  }

  // Numbers of cars that are close to each other stand beside each other.
  drawBadge(context, view, drive, row) {
    const pose = drive.pose(row, this.factor);
    const [px, py] = view.toScreen(pose.x, pose.y);
    const off = Math.max(0.5 * drive.car.width * view.scale, 10) + 14;
    drawNumber(context, px + 20 * (drive.number - 1), py - off, drive);
  }
}

// A road as a path in metres with the half width of its corridor, and where it starts, if it is known.
function drawRoad(context, view, ratio, { road, half, start }) {
  context.save();
  context.setTransform(...view.matrix(ratio));
  context.lineJoin = "round";
  const pixel = 1 / view.scale;
  const stroke = (color, width, dash = []) => {
    context.strokeStyle = color;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.stroke(road);
  };
  stroke(theme.colors.edge, Math.max(2 * half, 3 * pixel) + 3 * pixel);
  stroke(theme.colors.road, Math.max(2 * half, 3 * pixel));
  if (view.scale > 1.5) stroke(theme.colors.soft, 1.2 * pixel, [7 * pixel, 7 * pixel]);
  context.restore();
  if (!start || view.scale < 1) return;
  const [x, y, ahead, side] = start;
  const size = Math.hypot(ahead - x, side - y) || 1;
  const normal = [(-half * (side - y)) / size, (half * (ahead - x)) / size];
  context.beginPath();
  context.moveTo(...view.toScreen(x + normal[0], y + normal[1]));
  context.lineTo(...view.toScreen(x - normal[0], y - normal[1]));
  context.lineWidth = 3;
  context.strokeStyle = theme.colors.soft;
  context.stroke();
}

function drawWaypoint(context, px, py, drive) {
  context.beginPath();
  context.arc(px, py, 3.2, 0, 2 * Math.PI);
  context.fillStyle = theme.colors.paper;
  context.fill();
  context.lineWidth = 1.8;
  context.strokeStyle = drive.color;
  context.stroke();
}

function grid(context, view) {
  const step = roundStep(100 / view.scale, 1);
  const [left, bottom, right, top] = view.box();
  context.beginPath();
  for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
    context.moveTo(...view.toScreen(x, bottom));
    context.lineTo(...view.toScreen(x, top));
  }
  for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
    context.moveTo(...view.toScreen(left, y));
    context.lineTo(...view.toScreen(right, y));
  }
  context.lineWidth = 1;
  context.strokeStyle = theme.colors.line;
  context.stroke();
}

function scaleBar(context, view) {
  const metres = roundStep(70 / view.scale, 1);
  const length = metres * view.scale;
  const [left, low] = [view.width - 14 - length, view.height - 12];
  context.lineWidth = 2;
  context.strokeStyle = theme.colors.ink;
  context.beginPath();
  context.moveTo(left, low - 5);
  context.lineTo(left, low);
  context.lineTo(left + length, low);
  context.lineTo(left + length, low - 5);
  context.stroke();
  context.fillStyle = theme.colors.ink;
  context.font = `12px ${theme.font}`;
  context.textAlign = "center";
  context.textBaseline = "alphabetic";
  const words = metres >= 1000 ? `${metres / 1000} km` : metres >= 1 ? `${metres} m` : metres >= 0.01 ? `${number(100 * metres)} cm` : `${number(1000 * metres)} mm`;
  context.fillText(words, left + length / 2, low - 6);
}
