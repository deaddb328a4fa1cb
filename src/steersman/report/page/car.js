// A car from above: body, glass, wheels at their angles, velocity, number.

// Below this length on the screen a car is drawn as a pointer [pixels].
const SMALLEST_CAR = 26;

// Angles of the left and the right front wheel for the single-track angle (Ackermann).
function frontWheels(car, angle) {
  if (!car.ackermann || Math.abs(angle) < 1e-4) return [angle, angle];
  const cot = 1 / Math.tan(angle);
  const half = car.track / (2 * (car.lf + car.lr));
  return [cot - half, cot + half].map((value) => Math.atan2(Math.sign(angle), value * Math.sign(angle)));
}

function drawCar(context, view, drive, pose, ratio, alpha) {
  if (drive.car.length * view.scale < SMALLEST_CAR) {
    drawPointer(context, view, drive, pose);
    return;
  }
  const { car } = drive;
  const middle = (car.lf - car.lr) / 2;
  const pixel = 1 / view.scale;
  context.save();
  context.setTransform(...view.matrix(ratio));
  context.translate(pose.x, pose.y);
  context.rotate(pose.psi);
  const [left, right] = frontWheels(car, pose.wheel);
  context.fillStyle = theme.dark() ? "#000" : "#222";
  wheel(context, car, car.lf, car.track / 2, left);
  wheel(context, car, car.lf, -car.track / 2, right);
  wheel(context, car, -car.lr, car.track / 2, 0);
  wheel(context, car, -car.lr, -car.track / 2, 0);
  context.globalAlpha = alpha;
  body(context, middle, car.length, car.width, 0.55);
  context.fillStyle = drive.color;
  context.fill();
  context.globalAlpha = 1;
  context.lineWidth = 1.5 * pixel;
  context.strokeStyle = theme.colors.ink;
  context.stroke();
  glass(context, middle, car);
  // The wheels in front are what steers: they stay visible on the body.
  context.fillStyle = "#111";
  context.strokeStyle = "#fff";
  context.lineWidth = pixel;
  wheel(context, car, car.lf, car.track / 2, left, true);
  wheel(context, car, car.lf, -car.track / 2, right, true);
  context.restore();
}

function body(context, middle, length, width, radius) {
  context.beginPath();
  context.roundRect(middle - length / 2, -width / 2, length, width, Math.min(radius, width / 3));
}

function glass(context, middle, { length, width }) {
  context.fillStyle = "rgba(10, 16, 24, .55)";
  const pane = (from, to, a, b) => {
    context.beginPath();
    context.moveTo(middle + from * length, -a * width);
    context.lineTo(middle + to * length, -b * width);
    context.lineTo(middle + to * length, b * width);
    context.lineTo(middle + from * length, a * width);
    context.fill();
  };
  pane(0.2, 0.08, 0.4, 0.34);
  pane(-0.36, -0.26, 0.38, 0.33);
}

function wheel(context, { wheel: [length, width] }, x, y, angle, outlined = false) {
  context.save();
  context.translate(x, y);
  context.rotate(angle);
  context.beginPath();
  context.rect(-length / 2, -width / 2, length, width);
  context.fill();
  if (outlined) context.stroke();
  context.restore();
}

function drawPointer(context, view, drive, pose) {
  const [px, py] = view.toScreen(pose.x, pose.y);
  context.save();
  context.translate(px, py);
  context.rotate(-(pose.psi + view.turn));
  context.beginPath();
  context.moveTo(13, 0);
  context.lineTo(-9, 8);
  context.lineTo(-5, 0);
  context.lineTo(-9, -8);
  context.closePath();
  context.fillStyle = drive.color;
  context.fill();
  context.strokeStyle = theme.colors.ink;
  context.lineWidth = 1.5;
  context.stroke();
  context.restore();
}

// Where the car will be after so many seconds at this velocity.
const ARROW_SECONDS = 0.5;

function drawVelocity(context, view, pose) {
  const length = ARROW_SECONDS * pose.speed;
  if (length * view.scale < 8) return;
  const [x0, y0] = view.toScreen(pose.x, pose.y);
  const [x1, y1] = view.toScreen(pose.x + length * Math.cos(pose.course), pose.y + length * Math.sin(pose.course));
  const angle = Math.atan2(y1 - y0, x1 - x0);
  context.beginPath();
  context.moveTo(x0, y0);
  context.lineTo(x1 - 8 * Math.cos(angle), y1 - 8 * Math.sin(angle));
  for (const [width, color] of [[5, theme.colors.paper], [2.5, theme.colors.ink]]) {
    context.lineWidth = width;
    context.strokeStyle = color;
    context.stroke();
  }
  context.beginPath();
  context.moveTo(x1, y1);
  for (const side of [2.7, -2.7]) context.lineTo(x1 + 11 * Math.cos(angle + side), y1 + 11 * Math.sin(angle + side));
  context.closePath();
  context.fillStyle = theme.colors.ink;
  context.fill();
}

function drawNumber(context, px, py, drive) {
  context.beginPath();
  context.arc(px, py, 9, 0, 2 * Math.PI);
  context.fillStyle = theme.colors.paper;
  context.fill();
  context.lineWidth = 2.5;
  context.strokeStyle = drive.color;
  context.stroke();
  context.fillStyle = theme.colors.ink;
  context.font = `bold 11px ${theme.font}`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(String(drive.number), px, py + 0.5);
}
