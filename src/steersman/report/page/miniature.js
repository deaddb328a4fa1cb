// The whole road in a corner of the map, with the part that the map shows.

class Miniature {
  constructor(canvas) {
    this.canvas = canvas;
    this.view = new View();
  }

  draw(map, view, state) {
    const [left, bottom, right, top] = map.box;
    // Where the map itself shows nearly everything, there is nothing to tell.
    const small = (right - left) * view.scale < 1.3 * view.width && (top - bottom) * view.scale < 1.3 * view.height;
    this.canvas.hidden = small;
    if (small) return;
    const { context, width, height, ratio } = sized(this.canvas); // not while it is hidden
    if (!width) return;
    this.view.resize(width, height);
    this.view.fit(map.box, 8);
    context.save();
    context.setTransform(...this.view.matrix(ratio));
    context.lineWidth = 2.5 / this.view.scale;
    context.strokeStyle = theme.colors.soft;
    context.lineJoin = "round";
    context.stroke(map.road);
    context.restore();
    const [x0, y0, x1, y1] = view.box();
    const [a, b] = [this.view.toScreen(x0, y1), this.view.toScreen(x1, y0)];
    context.lineWidth = 1.5;
    context.strokeStyle = theme.colors.ink;
    context.strokeRect(a[0], a[1], Math.max(b[0] - a[0], 3), Math.max(b[1] - a[1], 3));
    for (const drive of map.drives) {
      if (!drive.length || state.hidden.has(drive)) continue;
      const pose = drive.pose(drive.row(state.axis, state.cursor));
      context.beginPath();
      context.arc(...this.view.toScreen(pose.x, pose.y), 4, 0, 2 * Math.PI);
      context.fillStyle = drive.color;
      context.fill();
      context.strokeStyle = theme.colors.paper;
      context.stroke();
    }
  }
}
