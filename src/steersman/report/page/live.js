// The live page: what is chosen, sent to the server at every change, and what it answers.

const WAIT = 1000; // until a server that is gone is looked for again [ms]
const MOST_PINS = 5;
const SIDE = 11; // cells along a side of the map of failures
const BATCH = 4; // of its drives in one request
// A number for a box: four digits, and never a power of ten.
function short(value) {
  if (typeof value !== "number") return "";
  const rounded = Number(value.toPrecision(4));
  if (!rounded || Math.abs(rounded) >= 1e-6) return String(rounded);
  return rounded.toFixed(Math.min(3 - Math.floor(Math.log10(Math.abs(rounded))), 20)).replace(/0+$/, "");
}
// What differs from what the page began with, in words.
function differing({ parts, disturbances, settings }, first) {
  const out = [];
  const fields = (now, was) => Object.entries(now).filter(([name, value]) => was[name] !== value).map(([name, value]) => `${name}=${typeof value === "number" ? short(value) : value}`);
  for (const [family, part] of Object.entries(parts)) {
    const was = first.parts[family] || { fields: {} };
    if (part.word !== was.word) out.push(part.word);
    out.push(...fields(part.fields, part.word === was.word ? was.fields : {}));
  }
  out.push(...disturbances.flatMap((one) => [one.word, ...fields(one.fields, {})]), ...fields(settings, first.settings));
  return out;
}
const byId = (id) => document.getElementById(id);

function complain(words) {
  byId("notice").textContent = words;
  byId("notice").hidden = !words;
}

async function send(token, place, body) {
  const answer = await fetch(place, { method: "POST", headers: { "x-steersman-token": token }, body: JSON.stringify(body) });
  const text = await answer.text();
  let found;
  try {
    found = JSON.parse(text);
  } catch {
    found = { error: text };
  }
  return answer.ok ? found : { error: found.error || text };
}

// The choices as form elements, from the declarations of the components.
class LiveForm {
  constructor(node, { form, first }, changed) {
    Object.assign(this, { node, form, changed, first, chosen: structuredClone(first) });
    for (const family of Object.keys(form.families)) node.append(this.family(family));
    node.append(this.disturbances(), this.settings());
    node.addEventListener("submit", (event) => event.preventDefault());
  }

  family(name) {
    const words = this.form.families[name];
    const part = this.chosen.parts[name];
    const known = part.word in words ? Object.keys(words) : [part.word, ...Object.keys(words)];
    const own = this.first.parts[name];
    const label = (word) => (own && word === own.word && this.form.labels[name]) || word;
    const select = element("select", { "aria-label": name, name }, ...known.map((word) => element("option", { value: word, title: word }, label(word))));
    select.value = part.word;
    const fields = element("div", {});
    const fill = () => fields.replaceChildren(...(words[part.word] || []).map((field) => this.field(field, part.fields, `${name}.`)));
    select.addEventListener("change", () => {
      // What the page began with comes back as it was: a file, or gains of a tuning.
      Object.assign(part, own && select.value === own.word ? structuredClone(own) : { word: select.value, fields: {} });
      fill();
      this.changed();
    });
    fill();
    return element("fieldset", {}, element("legend", {}, name), select, element("details", { open: name === "controller" ? "" : null }, element("summary", {}, "fields"), fields));
  }

  // Another component, from elsewhere than the list; it may be a file that was written anew.
  take(name, part) {
    this.chosen.parts[name] = part;
    this.node.replaceChild(this.family(name), this.node.children[Object.keys(this.form.families).indexOf(name)]);
    this.changed();
  }

  disturbances() {
    const words = this.form.disturbances;
    const rows = Object.keys(words).map((word) => {
      const fields = element("div", {});
      const find = () => this.chosen.disturbances.find((one) => one.word === word);
      const box = element("input", { type: "checkbox" });
      const fill = () => fields.replaceChildren(...(find() ? words[word].map((field) => this.field(field, find().fields, `${word}.`)) : []));
      box.checked = Boolean(find());
      box.addEventListener("change", () => {
        if (box.checked) this.chosen.disturbances.push({ word, fields: {} });
        else this.chosen.disturbances = this.chosen.disturbances.filter((one) => one.word !== word);
        fill();
        this.changed();
      });
      fill();
      return element("div", {}, element("label", {}, box, ` ${word.replaceAll("_", " ")}`), fields);
    });
    return element("fieldset", {}, element("legend", {}, "disturbances"), element("details", {}, element("summary", {}, "choose"), ...rows));
  }

  settings() {
    return element("fieldset", {}, element("legend", {}, "drive"), ...this.form.settings.map((field) => this.field(field, this.chosen.settings, "")));
  }

  // One field: its name, a box for its value, and for a number a slider.
  field(field, values, before) {
    const { name, unit, meaning, low, high, log } = field;
    const id = `${before}${name}`;
    const given = () => (name in values ? values[name] : field.default);
    const row = element("div", { class: "field", title: meaning });
    const unitText = unit === "-" ? [] : [element("small", {}, ` [${unit}]`)];
    const write = (value) => {
      if (value === field.default) delete values[name];
      else values[name] = value;
      row.classList.toggle("changed", name in values);
      this.changed();
    };
    row.classList.toggle("changed", name in values);
    row.append(element("label", { for: id }, name.replaceAll("_", " "), ...unitText));
    if (field.type === "true or false") {
      const box = element("input", { id, type: "checkbox" });
      box.checked = Boolean(given());
      box.addEventListener("change", () => write(box.checked));
      row.append(box);
    } else if (field.type === "choice") {
      const select = element("select", { id }, ...field.choices.map((choice) => element("option", { value: String(choice) }, String(choice))));
      select.value = String(given());
      select.addEventListener("change", () => write(field.choices.find((choice) => String(choice) === select.value)));
      row.append(select);
    } else if (low === undefined) {
      const box = element("input", { id, type: "text", value: given() ?? "" });
      box.addEventListener("change", () => write(box.value || field.default));
      row.append(box);
    } else {
      const whole = field.type === "whole number";
      const box = element("input", { id, type: "number", step: whole ? "1" : "any", value: short(given()) });
      const [from, to] = log ? [Math.log(low), Math.log(high)] : [low, high];
      const slider = element("input", { type: "range", min: from, max: to, step: whole && !log ? 1 : (to - from) / 400, "aria-label": id });
      const place = (value) => (log ? Math.log(Math.max(value, low)) : value);
      slider.value = place(given() ?? low);
      slider.addEventListener("input", () => {
        const at = Number(slider.value);
        // Steps of a range across zero miss it by what rounding leaves.
        const value = log ? Math.exp(at) : Math.abs(at) < (to - from) / 1e6 ? 0 : at;
        box.value = whole ? Math.round(value) : short(value);
        write(Number(box.value));
      });
      box.addEventListener("change", () => {
        const value = box.value === "" ? field.default : Number(box.value);
        slider.value = place(value ?? low);
        write(value);
      });
      row.append(box, slider);
    }
    return row;
  }
}

// A map over two disturbances that fills from coarse to fine, until all is driven or changed.
class FailureMap {
  constructor(token, axes) {
    Object.assign(this, { token, axes, turn: 0 });
    const names = Object.keys(axes);
    this.selects = ["x", "y"].map((axis, k) => {
      const select = document.querySelector(`[data-axis=${axis}]`);
      select.append(...names.map((name) => element("option", { value: name }, name.replaceAll("_", " "))));
      select.value = names[2 * (1 - k)];
      return select;
    });
    this.cells = Array.from({ length: SIDE * SIDE }, () => element("span", {}));
    byId("cells").append(...this.cells);
    this.stop();
  }

  // What was driven holds no longer.
  stop() {
    this.turn++;
    for (const axis of ["x", "y"]) byId(`ends-${axis}`).replaceChildren();
    for (const cell of this.cells) {
      cell.className = cell.textContent = cell.title = "";
      cell.style.background = "";
    }
    byId("filled").textContent = "";
  }

  async fill(choices) {
    this.stop();
    const { turn } = this;
    const [x, y] = this.selects.map((select) => select.value);
    const share = (name, k) => this.axes[name].low + ((1 - this.axes[name].low) * k) / (SIDE - 1);
    const places = this.cells.map((_, k) => [k % SIDE, SIDE - 1 - Math.floor(k / SIDE), k]);
    const coarse = ([i, j]) => [5, 2].findIndex((step) => i % step === 0 && j % step === 0);
    const order = places.sort((a, b) => (coarse(a) + 3) % 3 - (coarse(b) + 3) % 3 || a[2] - b[2]);
    for (let k = 0; k < order.length; k += BATCH) {
      const batch = order.slice(k, k + BATCH);
      const points = batch.map(([i, j]) => [share(x, i), share(y, j)]);
      const found = await send(this.token, "/map", { choices, x, y, points });
      if (turn !== this.turn) return;
      if (found.error) {
        complain(found.error);
        return;
      }
      for (const axis of ["x", "y"]) byId(`ends-${axis}`).replaceChildren(...found.ends[axis].map((text) => element("span", {}, text)));
      found.cells.forEach((one, n) => this.put(this.cells[batch[n][2]], one));
      byId("filled").textContent = `${Math.min(k + BATCH, order.length)} of ${order.length} drives`;
    }
  }

  put(cell, { failed, end, max_error_mm, words }) {
    cell.title = `${words}: ${failed ? end : `largest error ${max_error_mm.toPrecision(3)} mm`}`;
    cell.onpointerenter = () => (byId("cell").textContent = cell.title);
    if (failed) Object.assign(cell, { className: "failed", textContent: "✕" });
    // From a tenth of a millimetre to ten metres.
    const strength = clamp((Math.log10(Math.max(max_error_mm, 0.1)) + 1) / 5, 0, 1);
    if (!failed) cell.style.background = `color-mix(in srgb, var(--accent) ${Math.round(100 * strength)}%, var(--paper))`;
  }
}

// A training that goes on: curves, states and alarms; its newest policy and validation drive.
class LiveTraining {
  constructor(given, { drive, replay }) {
    Object.assign(this, { token: given.token, replay, seen: 0, shown: 0, section: byId("training") });
    if (!given.training) return;
    this.section.hidden = false;
    this.section.querySelector("[data-word=folder]").textContent = given.training;
    byId("newest").addEventListener("click", () => drive(this.policy));
    this.buttons = [...this.section.querySelectorAll("[data-ask]")];
    for (const button of this.buttons) button.addEventListener("click", () => this.ask({ ask: button.dataset.ask }));
    byId("validations").addEventListener("change", () => {
      this.shown = 0;
      this.ask({});
    });
    this.follow();
  }

  follow() {
    setTimeout(() => this.follow(), 2 * WAIT);
    this.ask({});
  }

  async ask(more) {
    const wanted = byId("validations").checked ? { drive: this.shown } : {};
    // Where the server is gone, the next drive says so.
    const found = await send(this.token, "/training", { seen: this.seen, ...wanted, ...more }).catch(() => null);
    if (!found) return;
    if (found.error) {
      complain(found.error);
      return;
    }
    this.states(found.states);
    if (found.seen > this.seen) this.show(found);
    if (found.drive && found.drive.stamp > this.shown) {
      this.shown = found.drive.stamp;
      await this.replay(found.drive);
    }
  }

  states(states) {
    const any = (state) => states.some((one) => one.state === state);
    const usable = { pause: any("running"), "go on": any("paused"), stop: any("running") || any("paused") };
    for (const button of this.buttons) button.disabled = !usable[button.dataset.ask];
    // What has ended is not paused, stopped or shown anything.
    const over = states.length > 0 && !any("running") && !any("paused");
    for (const button of [...this.buttons, byId("demonstrate")]) button.hidden = over;
    const rows = states.map(({ words, alarms }) => element("li", {}, words, ...alarms.map((alarm) => element("div", { class: "alarm" }, `⚠ ${alarm}`))));
    byId("states").replaceChildren(...rows);
  }

  show({ seen, training, policy }) {
    Object.assign(this, { seen, policy });
    byId("newest").disabled = !policy;
    if (!training) return;
    const old = this.section.querySelector(".log");
    const log = old.cloneNode();
    log.checked = old.checked;
    old.replaceWith(log);
    const chips = training.runs.map((run, k) => element("button", { type: "button", class: "chip", "data-run": String(k), "aria-pressed": "true" }, lineSample({ color: run.color, dash: DASHES[run.dash] || [] }), run.name));
    this.section.querySelector(".legend").replaceChildren(...chips);
    this.section.querySelector(".curves").replaceChildren();
    startTraining(this.section, training);
    if (log.checked) log.dispatchEvent(new Event("change"));
  }
}

class LivePage {
  constructor(given) {
    this.given = given;
    this.pins = [];
    this.failures = new FailureMap(given.token, given.form.axes);
    this.form = new LiveForm(byId("form"), given, () => {
      this.failures.stop();
      this.drive();
    });
    byId("fill").addEventListener("click", () => this.failures.fill(structuredClone(this.form.chosen)));
    this.hand = new HandAtWheel(given.token, (found) => this.handed(found));
    byId("pin").addEventListener("click", () => this.pin());
    byId("unpin").addEventListener("click", () => {
      this.pins = [];
      this.drive();
    });
    for (const name of ["command", "yaml"]) {
      byId(`copy-${name}`).addEventListener("click", () => navigator.clipboard.writeText(byId(name).textContent));
    }
    this.training = new LiveTraining(given, {
      drive: (policy) => this.form.take("controller", policy),
      replay: (found) => this.show(found),
    });
    byId("wheel").addEventListener("click", () => this.hand.drive(this.form.chosen));
    byId("demonstrate").addEventListener("click", () => this.hand.drive(null));
    this.drive();
  }

  pin() {
    const choices = structuredClone(this.form.chosen);
    const differs = differing(choices, this.given.first);
    const more = differs.length > 3 ? ", ..." : "";
    const words = differs.slice(0, 3).join(", ") + more || "as begun";
    const alike = this.pins.filter((one) => one.words === words).length;
    const name = alike ? `pinned: ${words} (${alike + 1})` : `pinned: ${words}`;
    if (this.pins.some((one) => JSON.stringify(one.choices) === JSON.stringify(choices))) return;
    this.pins = [...this.pins, { name, words, choices }].slice(-MOST_PINS);
    this.drive();
  }

  // One request at a time; what changes meanwhile is sent as soon as it is answered.
  async drive() {
    if (this.busy) {
      this.again = true;
      return;
    }
    this.busy = true;
    const now = { name: "now", choices: structuredClone(this.form.chosen) };
    const same = (one) => JSON.stringify(one.choices) === JSON.stringify(now.choices);
    if (this.last && !same(this.last)) this.before = { ...this.last, name: "before" };
    const runs = [now, ...[this.before].filter((one) => one && !same(one)), ...this.pins.map(({ name, choices }) => ({ name, choices }))];
    const begun = performance.now();
    const found = await send(this.given.token, "/drive", runs).catch(() => null);
    if (!found) {
      complain(`The server does not answer. Start it again with: ${this.given.again}`);
      setTimeout(() => this.drive(), WAIT);
    } else {
      complain(found.error || found.note || "");
      if (!found.error) {
        this.last = now;
        byId("pin").disabled = false;
        byId("hints").replaceChildren(...found.hints.map((line) => element("li", {}, line)));
        await this.show(found);
        const took = Math.round(performance.now() - begun);
        byId("took").textContent = `driven and shown in ${took} ms`;
      }
    }
    this.busy = false;
    byId("unpin").disabled = !this.pins.length;
    if (this.again) {
      this.again = false;
      this.drive();
    }
  }

  async show(found) {
    const data = JSON.parse(new TextDecoder().decode(await inflated(found.data)));
    const columns = new Columns(await inflated(found.columns_data));
    this.figures(found.figures);
    for (const name of ["command", "yaml"]) if (found[name]) byId(name).textContent = found[name];
    if (!data.groups.length) return;
    if (this.player) {
      const { cursor } = this.player.state;
      Object.assign(this.player, { data, columns });
      fillKinds(this.player.parts, data.groups);
      fillRoads(this.player.parts, data.groups);
      this.player.open(0);
      this.player.seek(cursor);
    } else {
      this.player = new Player(byId("replay"), data, columns);
      new Keys(this.player);
    }
  }

  figures({ runs, rows }) {
    const [head, body] = byId("figures").children;
    head.replaceChildren(element("tr", {}, element("th", { scope: "col" }, "figure"), ...runs.map((name) => element("th", { scope: "col", class: "number" }, name))));
    body.replaceChildren(
      ...rows.map(({ name, unit, cells }) =>
        element("tr", {}, element("th", { scope: "row" }, unit ? `${name} [${unit}]` : name), ...cells.map((cell) => element("td", { class: cell.bad ? "number bad" : "number" }, cell.text))),
      ),
    );
  }

  async handed(found) {
    complain(found.error || "");
    if (found.error) return;
    byId("pin").disabled = true; // what it would keep is not what is shown
    byId("kept").textContent = `By hand: ${found.how}. Kept in ${found.kept}; to learn from it: steersman imitate demo method=bc data=${found.kept} --out runs/like_me`;
    await this.show(found);
  }
}

async function start() {
  theme.start();
  const wide = matchMedia("(min-width: 861px)");
  const open = () => (byId("choose").open = wide.matches);
  wide.addEventListener("change", open);
  open();
  const given = JSON.parse(new TextDecoder().decode(await unpacked("given")));
  window.steersman = new LivePage(given);
}

start();
