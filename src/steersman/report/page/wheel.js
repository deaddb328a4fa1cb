// The wheel: keys or a game pad steer, and the road as it is driven, from behind and above the car.

const HANDS_ON = 500; // after the last key there are hands on the wheel for so long [ms]
const HARDEST = 20; // keys steer so far times speed squared: about 4 m/s^2 to the side [m^2/s^2]
const AHEAD = 4; // seconds of road ahead of the car
const [NEAREST, FARTHEST_AHEAD] = [35, 130]; // metres of it, at least and at most
const CAR_AT = 0.72; // of the picture's height, from its top
const FOLLOWS = 0.25; // time in which the picture turns after the car [s]
const TRAIL = 400; // points of the line behind the car
const LANE = 3; // half width of a road whose corridor is not known [m]
const SOME_CAR = { lf: 1.5, lr: 1.4, track: 1.6, length: 4.7, width: 1.85, ackermann: false, wheel: [0.7, 0.22] };

const wrapped = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));

function beside(error) {
  const size = Math.abs(error);
  return `${size < 0.995 ? `${(100 * size).toFixed(0)} cm` : `${size.toFixed(2)} m`} ${error > 0 ? "left" : "right"} of the path`;
}

// The road from above, the car in the lower part of the picture pointing up.
class WheelView {
  constructor(canvas) {
    Object.assign(this, { canvas, view: new View() });
  }

  // A new drive, on a road that is known whole, or seen piece by piece.
  begin(given) {
    Object.assign(this, { given, trail: [], passed: [], last: null, own: { x: 0, y: 0, psi: 0 } });
    this.half = given ? given.half : LANE;
    this.car = given ? given.car : SOME_CAR;
    if (given) this.road = pathOf(given.x.map((x, k) => [x, given.y[k]]));
  }

  draw(found) {
    const seconds = this.last ? found.time - this.last.time : -1;
    const pose = this.given ? found : this.reckoned(found, seconds);
    if (!this.last || seconds < 0) Object.assign(this, { turn: Math.PI / 2 - pose.psi, trail: [] });
    this.last = found;
    this.trail = [...this.trail, [pose.x, pose.y]].slice(-TRAIL);
    const { context, width, height, ratio } = sized(this.canvas);
    this.look(pose, seconds, found.speed, width, height);
    context.fillStyle = theme.colors.ground;
    context.fillRect(0, 0, width, height);
    grid(context, this.view);
    const start = this.given ? [this.given.x[0], this.given.y[0], this.given.x[1], this.given.y[1]] : null;
    drawRoad(context, this.view, ratio, { road: this.road, half: this.half, start });
    this.behind(context);
    drawCar(context, this.view, { car: this.car, color: theme.colors.accent }, { ...pose, wheel: found.wheel ?? 0.6 * found.steer }, ratio, 0.85);
    scaleBar(context, this.view);
    this.figures(context, width, found);
  }

  // So much of the road ahead as is driven in some seconds; the picture turns after the car.
  look({ x, y, psi }, seconds, speed, width, height) {
    const { view } = this;
    view.resize(width, height);
    const share = 1 - Math.exp(-clamp(seconds, 0, 1) / FOLLOWS);
    this.turn += share * wrapped(Math.PI / 2 - psi - this.turn);
    view.turn = this.turn;
    view.scale = (CAR_AT * height) / clamp(AHEAD * speed, NEAREST, FARTHEST_AHEAD);
    const up = ((CAR_AT - 0.5) * height) / view.scale;
    view.x = x + up * Math.sin(this.turn);
    view.y = y + up * Math.cos(this.turn);
  }

  // The car of a training tells its motion and what it sees; both are added up from its start.
  reckoned({ v_x, v_y, yaw_rate, preview }, seconds) {
    if (seconds < 0 || seconds > 1) Object.assign(this, { passed: [], own: { x: 0, y: 0, psi: 0 } });
    else {
      const { own } = this;
      own.psi += yaw_rate * seconds;
      own.x += (v_x * Math.cos(own.psi) - v_y * Math.sin(own.psi)) * seconds;
      own.y += (v_x * Math.sin(own.psi) + v_y * Math.cos(own.psi)) * seconds;
    }
    const { x, y, psi } = this.own;
    const [cos, sin] = [Math.cos(psi), Math.sin(psi)];
    const ahead = preview.map(([a, b]) => [x + cos * a - sin * b, y + sin * a + cos * b]);
    this.road = pathOf([...this.passed, ...ahead]);
    this.passed = [...this.passed, ahead[0]].slice(-TRAIL);
    return this.own;
  }

  behind(context) {
    context.beginPath();
    for (const [x, y] of this.trail) context.lineTo(...this.view.toScreen(x, y));
    Object.assign(context, { strokeStyle: theme.colors.accent, lineWidth: 2.5, lineJoin: "round" });
    context.stroke();
  }

  // Speed, and the distance from the path on a scale as wide as the corridor.
  figures(context, width, { speed, lateral_error }) {
    const { colors, font } = theme;
    const [middle, reach, y] = [width / 2, Math.min(0.25 * width, 120), 40];
    context.fillStyle = colors.panel;
    context.globalAlpha = 0.85;
    context.fillRect(0, 0, width, 56);
    context.globalAlpha = 1;
    context.fillStyle = colors.ink;
    context.textBaseline = "alphabetic";
    context.textAlign = "left";
    context.font = `600 18px ${font}`;
    context.fillText(`${(3.6 * speed).toFixed(0)} km/h`, 12, 24);
    context.font = `12px ${font}`;
    context.fillStyle = colors.soft;
    context.fillText(`${speed.toFixed(1)} m/s`, 12, 44);
    context.textAlign = "center";
    context.fillStyle = colors.ink;
    context.fillText(beside(lateral_error), middle, 20);
    context.strokeStyle = colors.soft;
    context.lineWidth = 1.5;
    context.beginPath();
    for (const side of [-1, 0, 1]) {
      context.moveTo(middle + side * reach, y - 6);
      context.lineTo(middle + side * reach, y + 6);
    }
    context.moveTo(middle - reach, y);
    context.lineTo(middle + reach, y);
    context.stroke();
    const share = clamp(lateral_error / this.half, -1, 1);
    context.beginPath();
    context.arc(middle - share * reach, y, 6, 0, 2 * Math.PI);
    context.fillStyle = Math.abs(share) > 0.7 ? colors.bad : colors.accent;
    context.fill();
  }
}

function pathOf(points) {
  const path = new Path2D();
  for (const [x, y] of points) path.lineTo(x, y);
  return path;
}

// Takes the wheel: keys and game pad to the server, and what the driver sees from it.
class HandAtWheel {
  constructor(token, ended) {
    Object.assign(this, { token, ended, steer: 0, keys: new Set(), canvas: byId("view") });
    this.view = new WheelView(this.canvas);
    const known = { ArrowLeft: 1, a: 1, A: 1, ArrowRight: -1, d: -1, D: -1, " ": 0, ArrowUp: 0 };
    this.down = (event) => {
      if (event.key === "Escape") this.stopping = true;
      if (!(event.key in known)) return;
      this.keys.add(known[event.key]);
      event.preventDefault();
      event.stopPropagation();
    };
    this.up = (event) => this.keys.delete(known[event.key]);
  }

  // A drive of its own from its choices, or without them the car of the training.
  async drive(choices) {
    const place = choices ? "/wheel" : "/demonstrate";
    byId("hand-note").textContent = choices
      ? "The drive is recorded as a demonstration."
      : "Steering, or the space bar for straight on, demonstrates; hands off, the agent drives. The training waits for its moment while this is open.";
    byId("hand-values").textContent = choices ? "" : "The training has not asked yet.";
    byId("hand").hidden = false;
    this.canvas.focus();
    window.addEventListener("keydown", this.down, true);
    window.addEventListener("keyup", this.up, true);
    Object.assign(this, { steer: 0, stopping: false, held: -Infinity, pad: false });
    let found = await send(this.token, place, choices ? { act: "start", choices } : { act: "steer", steer: null });
    let before = performance.now();
    this.view.begin(found.road);
    while (!found.error && !found.ended) {
      await new Promise((next) => setTimeout(next, 33));
      const now = performance.now();
      this.turn((now - before) / 1000, found.speed || 0);
      before = now;
      const hands = choices || now - this.held < HANDS_ON;
      found = await send(this.token, place, { act: this.stopping ? "stop" : "steer", steer: hands ? this.steer : null });
      if (found.psi === undefined && !found.preview) continue;
      this.view.draw(found);
      const who = choices ? "" : hands ? ", you demonstrate" : ", the agent drives";
      byId("hand-values").textContent = `${found.time.toFixed(1)} s, ${beside(found.lateral_error)}, steering ${found.steer.toFixed(3)}${this.pad ? ", game pad" : ""}${who}`;
    }
    window.removeEventListener("keydown", this.down, true);
    window.removeEventListener("keyup", this.up, true);
    byId("hand").hidden = true;
    if (choices || found.error) this.ended(found);
  }

  // Keys turn the wheel at a rate, and less far the faster the car is; a pad sets its angle.
  turn(seconds, speed) {
    const most = clamp(HARDEST / Math.max(speed, 1) ** 2, 0.03, 0.6);
    const held = (one) => one && (Math.abs(one.axes[0]) > 0.05 || one.buttons.some(({ pressed }) => pressed));
    const pad = [...navigator.getGamepads()].find(held);
    if (pad || this.keys.size) this.held = performance.now();
    const wanted = pad ? -pad.axes[0] * most : [...this.keys].reduce((sum, key) => sum + key, 0) * most;
    this.steer += clamp(wanted - this.steer, -1.5 * most * seconds, 1.5 * most * seconds);
    if (pad) this.steer = wanted;
    this.pad = Boolean(pad);
  }
}
