// The lane above the slider: where the marks are, and how long what they mark took.

// Half the width of the slider's thumb: where its track begins [pixels].
const THUMB = 8;

class Lane {
  constructor(canvas, jump) {
    this.canvas = canvas;
    this.places = [];
    canvas.addEventListener("click", (event) => {
      const near = (place) => Math.abs(place.px - event.offsetX);
      const best = this.places.reduce((a, b) => (near(b) < near(a) ? b : a), { px: Infinity });
      if (near(best) < 14) jump(best.mark);
    });
  }

  draw(state, drives) {
    const { context, width, height } = sized(this.canvas);
    const [low, high] = state.range;
    const at = (cursor) => THUMB + ((cursor - low) / Math.max(high - low, 1e-9)) * (width - 2 * THUMB);
    this.places = [];
    const marks = sortedMarks(drives.filter((drive) => !state.hidden.has(drive))).reverse();
    for (const mark of marks) {
      const values = mark.drive[state.axis];
      const px = at(values[mark.row]);
      if (mark.until > mark.row) {
        context.globalAlpha = 0.45;
        context.fillStyle = mark.drive.color;
        context.fillRect(px, height / 2 - 3, Math.max(at(values[mark.until]) - px, 1), 6);
        context.globalAlpha = 1;
      }
      drawGlyph(context, mark.kind, px, height / 2, 5, mark.drive.color);
      this.places.push({ px, mark });
    }
  }
}
