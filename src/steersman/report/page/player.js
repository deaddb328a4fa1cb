// The replay: what is shown (state), what changes it, and the loop that draws it.

// Width of what is first seen of the road [m].
const NEAR = 90;
const RATES = [0.1, 0.25, 0.5, 1, 2, 5, 10, 30];

class Player {
  constructor(section, data, columns) {
    Object.assign(this, { section, data, columns, parts: partsOf(section), view: new View(), drawn: {} });
    const shown = new Set(data.signals.filter((signal) => signal.shown).map((signal) => signal.key));
    this.state = { cursor: 0, axis: "time", span: Infinity, rate: 1, playing: false, follow: true, turned: false, shown };
    const { map, base, overlay, lane } = this.parts;
    this.panels = new Panels(base, overlay, data.signals, (cursor) => this.seek(cursor));
    this.lane = new Lane(lane, (mark) => this.jump(mark));
    moveByPointers(map, this.view, (how) => this.moved(how));
    fillSignals(this.parts.choose, data.signals, shown, () => this.layout());
    fillKinds(this.parts, data.groups);
    fillRoads(this.parts, data.groups);
    this.pair = [];
    this.connect();
    this.open(0);
    new ResizeObserver(() => this.layout()).observe(section);
    theme.listeners.push(() => {
      this.lists();
      this.redraw();
    });
  }

  connect() {
    const { play, slider, rate, kind, road, one, two, axis, span, magnify } = this.parts;
    const on = (name, act) => this.parts[name].addEventListener("click", act);
    on("play", () => this.toggle());
    on("next", () => this.step(1));
    on("previous", () => this.step(-1));
    on("fit", () => this.fit());
    on("follow", () => this.followOn(!this.state.follow));
    on("turn", () => this.turnOn(!this.state.turned));
    on("closer", () => this.zoom(1.4));
    on("farther", () => this.zoom(1 / 1.4));
    slider.addEventListener("input", () => this.seek(Number(slider.value)));
    rate.replaceChildren(...RATES.map((value) => element("option", { value: String(value) }, `${value}×`)));
    rate.addEventListener("change", () => this.setRate(Number(rate.value)));
    road.addEventListener("change", () => this.open(Number(road.value)));
    kind.addEventListener("change", () => {
      fillRoads(this.parts, this.data.groups);
      this.open(Number(road.value));
    });
    for (const select of [one, two]) select.addEventListener("change", () => this.showPair());
    axis.addEventListener("change", () => this.setAxis(axis.value));
    span.addEventListener("change", () => this.setSpan());
    magnify.addEventListener("change", () => {
      this.map.magnify(Number(magnify.value));
      this.redraw();
    });
    play.disabled = false;
  }

  // Show the drives of another road.
  open(index) {
    const group = this.data.groups[index];
    this.drives = group.runs.map((run, k) => new Drive(run, k, this.columns));
    this.map = new RoadMap(group, this.drives, this.columns);
    this.map.magnify(Number(this.parts.magnify.value));
    const lead = this.drives.find((drive) => drive.length) || this.drives[0];
    // Of a crowd on one road, the first are seen until others are asked for.
    const hidden = new Set(this.drives.length > CROWD ? this.drives.slice(CROWD) : []);
    const paired = Boolean(group.kind) && this.drives.length > 2;
    this.parts.one.closest(".pair").hidden = !paired;
    Object.assign(this.state, { hidden, lead, playing: false });
    this.lists();
    this.parts.note.textContent = remarks(group, this.drives, hidden);
    this.section.dataset.group = String(index);
    this.range();
    this.state.cursor = this.state.range[0];
    this.setRate(this.state.rate);
    this.layout();
    this.view.resize(this.parts.map.clientWidth, this.parts.map.clientHeight);
    this.view.scale = clamp(this.view.width / NEAR, 3, 14);
    this.setLead(lead);
    if (paired) {
      fillPair(this.parts, this.drives, this.pair);
      this.showPair(false);
    }
  }

  // Show two drives and no other; the choice holds for the next group where it was a person's.
  showPair(chosen = true) {
    const pair = [this.parts.one, this.parts.two].map((select) => this.drives[Number(select.value)]);
    if (chosen) this.pair = pair.map(({ name }) => name);
    this.state.hidden = new Set(this.drives.filter((drive) => !pair.includes(drive)));
    this.range();
    this.press();
    this.setLead(pair[0]);
    this.redraw();
  }

  // What HTML shows of drives and marks; anew where colours change.
  lists() {
    const { drives, moments, count, legend } = this.parts;
    this.rows = fillDrives(drives, this.drives, (drive) => this.show(drive), (drive) => this.setLead(drive));
    count.textContent = String(fillMoments(moments, this.drives, (mark) => this.jump(mark)));
    const has = (kind) => this.drives.some((drive) => drive.marks.some((mark) => mark.kind === kind));
    fillLegend(legend, Object.keys(KINDS).filter(has));
    this.press();
  }

  // Which drives are shown and which is followed, as their buttons tell it.
  press() {
    for (const [drive, row] of this.rows) {
      row.chip.setAttribute("aria-pressed", String(!this.state.hidden.has(drive)));
      row.lead.setAttribute("aria-pressed", String(drive === this.state.lead));
    }
  }

  // Least and largest cursor.
  range() {
    const { axis, hidden } = this.state;
    const shown = this.drives.filter((drive) => drive.length && !hidden.has(drive));
    const low = Math.min(...shown.map((drive) => drive[axis][0]));
    const high = Math.max(...shown.map((drive) => drive[axis][drive.length - 1]));
    this.state.range = low <= high ? [low, high] : [0, 0];
    const { slider } = this.parts;
    [slider.min, slider.max] = this.state.range;
    this.state.cursor = clamp(this.state.cursor, ...this.state.range);
  }

  layout() {
    const count = Math.max(this.state.shown.size, 1);
    this.panels.height = clamp((0.48 * window.innerHeight - FOOT) / count, ...PANEL);
    this.parts.signals.style.height = `${count * this.panels.height + FOOT}px`;
    this.redraw();
  }

  redraw() {
    this.stale = true;
    this.wake();
  }

  wake() {
    if (!this.pending) this.pending = requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    this.pending = 0;
    if (this.state.playing) this.advance(Math.min((now - this.before) / 1000, 0.1));
    this.before = now;
    this.draw();
    if (this.state.playing) this.wake();
  }

  advance(seconds) {
    const { state } = this;
    let step = seconds * state.rate;
    if (state.axis === "along") {
      const lead = state.lead;
      step *= Math.max(lead.value("speed", lead.row("along", state.cursor)) || 0, 1);
    }
    state.cursor += step;
    if (state.cursor >= state.range[1]) {
      state.cursor = state.range[1];
      this.playOn(false);
    }
  }

  draw() {
    const { state, view, parts, drives } = this;
    if (state.follow && state.lead.length) {
      const pose = state.lead.pose(state.lead.row(state.axis, state.cursor), this.map.factor);
      Object.assign(view, { x: pose.x, y: pose.y });
      if (state.turned) view.turn = Math.PI / 2 - pose.psi;
    }
    this.map.draw(parts.map, view, state);
    this.miniature ??= new Miniature(parts.mini);
    this.miniature.draw(this.map, view, state);
    // Signals are drawn anew where they changed or their window moved along.
    if (this.stale || state.span < state.range[1] - state.range[0]) {
      this.panels.draw(state, drives);
      this.lane.draw(state, drives);
      this.stale = false;
    }
    this.panels.drawCursor(state, drives);
    this.tell();
  }

  // What HTML tells of the state.
  tell() {
    const { state, parts } = this;
    parts.slider.value = String(state.cursor);
    const unit = state.axis === "time" ? "s" : "m";
    const words = `${state.cursor.toFixed(state.axis === "time" ? 2 : 1)} / ${state.range[1].toFixed(1)} ${unit}`;
    parts.time.textContent = words;
    parts.slider.setAttribute("aria-valuetext", words);
    for (const [drive, row] of this.rows) {
      const text = valuesAt(drive, state);
      if (row.values.textContent !== text) row.values.textContent = text;
    }
    Object.assign(this.section.dataset, {
      cursor: state.cursor.toFixed(3), playing: String(state.playing), follow: String(state.follow),
      scale: this.view.scale.toFixed(3), ready: "true",
    });
  }

  // What a screen reader is told when something was done, not at every frame.
  say(words) {
    this.parts.status.textContent = words;
  }

  seek(cursor) {
    this.state.cursor = clamp(cursor, ...this.state.range);
    this.wake();
  }

  toggle() {
    const { state } = this;
    if (!state.playing && state.cursor >= state.range[1]) state.cursor = state.range[0];
    this.playOn(!state.playing);
  }

  playOn(playing) {
    this.state.playing = playing;
    const { play } = this.parts;
    play.textContent = playing ? "❚❚" : "▶";
    play.setAttribute("aria-label", playing ? "Pause" : "Play");
    if (!playing) this.say(this.parts.time.textContent);
    this.before = performance.now();
    this.wake();
  }

  setRate(rate) {
    this.state.rate = rate;
    this.parts.rate.value = String(rate);
  }

  faster(steps) {
    const k = RATES.indexOf(this.state.rate) + steps;
    this.setRate(RATES[clamp(k, 0, RATES.length - 1)]);
    this.say(`${this.state.rate} times`);
  }

  setAxis(axis) {
    const { lead } = this.state;
    const row = lead.row(this.state.axis, this.state.cursor);
    this.state.axis = axis;
    this.state.cursor = lead.length ? lead.value(axis, row) : 0;
    this.range();
    this.setSpan();
  }

  // The window of the signals: so many seconds, or as many times ten metres.
  setSpan() {
    const seconds = Number(this.parts.span.value) || Infinity;
    this.state.span = this.state.axis === "time" ? seconds : 10 * seconds;
    this.redraw();
  }

  show(drive) {
    const { hidden } = this.state;
    const shown = hidden.delete(drive);
    if (!shown) hidden.add(drive);
    this.range();
    if (hidden.has(this.state.lead)) {
      const other = this.drives.find((each) => !hidden.has(each) && each.length);
      if (other) this.setLead(other);
    }
    this.press();
    this.redraw();
  }

  setLead(drive) {
    this.state.lead = drive;
    this.press();
    this.followOn(true);
  }

  followOn(follow) {
    this.state.follow = follow;
    this.parts.follow.setAttribute("aria-pressed", String(follow));
    this.wake();
  }

  turnOn(turned) {
    this.state.turned = turned;
    this.parts.turn.setAttribute("aria-pressed", String(turned));
    if (turned) this.followOn(true);
    else this.view.turn = 0;
    this.wake();
  }

  moved(how) {
    if (how === "pan") this.followOn(false);
    this.wake();
  }

  zoom(factor) {
    this.view.zoom(factor);
    this.wake();
  }

  fit() {
    this.followOn(false);
    this.turnOn(false);
    this.view.fit(this.map.box);
  }

  // Go to a mark: its drive is shown and followed.
  jump(mark) {
    if (this.state.hidden.has(mark.drive)) this.show(mark.drive);
    this.playOn(false);
    this.setLead(mark.drive);
    this.view.scale = Math.max(this.view.scale, 6);
    this.seek(mark.drive[this.state.axis][mark.row]);
    const { top, bottom } = this.parts.map.getBoundingClientRect();
    if (bottom < 80 || top > window.innerHeight - 80) this.section.scrollIntoView();
    this.say(`${mark.drive.name}, ${clock(markTime(mark))}: ${mark.text}`);
  }

  // The next mark, or the one before, of what is shown.
  step(direction) {
    const shown = this.drives.filter((drive) => !this.state.hidden.has(drive));
    const mark = nextMark(shown, this.state, direction);
    if (mark) this.jump(mark);
  }
}
