// One drive: its columns by row, between rows, and by the cursor.

class Drive {
  constructor(run, index, columns) {
    this.name = run.name;
    this.number = index + 1;
    this.given = run.color;
    this.dash = DASHES[run.dash] || [];
    this.end = run.end;
    this.completed = run.completed;
    this.dt = run.dt;
    this.kept = run.kept;
    this.car = run.car;
    this.marks = run.marks.map((mark) => ({ ...mark, drive: this }));
    for (const [name, entry] of Object.entries(run.columns)) this[name] = columns.read(entry);
    this.length = this.time.length;
    this.ranges = {};
    if (run.seen) {
      this.seen = { count: run.seen.count, every: run.seen.every, points: columns.read(run.seen.points) };
      this.seen.rows = this.seen.points.length / (2 * this.seen.count);
    }
  }

  get color() {
    return visible(this.given, theme.colors.ground);
  }

  // The row, with its fraction, at a cursor: axis "time" [s] or "along" the path [m].
  row(axis, cursor) {
    const values = this[axis];
    if (!this.length) return NaN;
    let low = 0;
    let high = this.length - 1;
    if (!(cursor > values[0])) return 0;
    if (cursor >= values[high]) return high;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (values[middle] <= cursor) low = middle;
      else high = middle;
    }
    const gap = values[high] - values[low];
    return gap > 0 ? low + (cursor - values[low]) / gap : low;
  }

  value(key, row) {
    const values = this[key];
    const i = Math.floor(row);
    if (!(i + 1 < this.length)) return this.length ? values[this.length - 1] : NaN;
    const share = row - i;
    return share === 0 ? values[i] : values[i] + share * (values[i + 1] - values[i]);
  }

  // Whether the drive is over at this cursor.
  over(axis, cursor) {
    return !this.length || cursor > this[axis][this.length - 1] + 1e-9;
  }

  // Where the car is; its distance from the path drawn so many times as large.
  pose(row, magnify = 1) {
    const extra = ((magnify - 1) * this.value("lateral_error", row)) / 1000;
    const tangent = this.value("tangent", row);
    return {
      x: this.value("x", row) - extra * Math.sin(tangent),
      y: this.value("y", row) + extra * Math.cos(tangent),
      psi: this.value("psi", row),
      wheel: this.value("wheel", row),
      course: this.value("psi", row) + this.value("slip", row),
      speed: this.value("speed", row),
    };
  }

  // Waypoints in the frame of the page as the controller saw them last, and the pose it had.
  waypoints(row) {
    if (!this.seen) return [];
    const { count, every, points, rows } = this.seen;
    const sample = clamp(Math.floor(row / every), 0, rows - 1);
    const pose = this.pose(Math.min(sample * every, this.length - 1));
    const cos = Math.cos(pose.psi);
    const sin = Math.sin(pose.psi);
    const out = [];
    for (let k = 0; k < count; k++) {
      const ahead = points[2 * k * rows + sample];
      const left = points[(2 * k + 1) * rows + sample];
      out.push([pose.x + cos * ahead - sin * left, pose.y + sin * ahead + cos * left]);
    }
    return out;
  }

  // Least and largest finite value of a signal between two rows.
  range(key, first = 0, last = this.length - 1) {
    const whole = first === 0 && last === this.length - 1;
    if (whole && this.ranges[key]) return this.ranges[key];
    let low = Infinity;
    let high = -Infinity;
    const values = this[key];
    for (let i = first; i <= last; i++) {
      if (values[i] < low) low = values[i];
      if (values[i] > high) high = values[i];
    }
    if (whole) this.ranges[key] = [low, high];
    return [low, high];
  }
}
