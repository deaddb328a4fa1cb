// The parts of the player that are HTML: its buttons, choices and lists.

// The elements of a player by the word in their data-part.
function partsOf(section) {
  const parts = {};
  for (const node of section.querySelectorAll("[data-part]")) parts[node.dataset.part] = node;
  return parts;
}

const options = (pairs) => pairs.map(([value, words]) => element("option", { value: String(value) }, words));

// Kinds of groups to choose from, where there are several.
function fillKinds({ kind }, groups) {
  const kinds = [...new Set(groups.map((group) => group.kind))];
  kind.replaceChildren(...options(kinds.map((name) => [name, name])));
  kind.closest("label").hidden = kinds.length < 2;
}

// The groups of the kind that is chosen.
function fillRoads({ road, kind }, groups) {
  const all = groups.map((group, k) => [k, group]).filter(([, group]) => group.kind === kind.value);
  road.replaceChildren(...options(all.map(([k, { title }]) => [k, title])));
  road.closest("label").hidden = groups.length < 2;
}

// Two of several drives to see beside each other: those with these names, or the first two.
function fillPair({ one, two }, drives, names) {
  const all = options(drives.map(({ name }, k) => [k, name]));
  one.replaceChildren(...all);
  two.replaceChildren(...all.map((option) => option.cloneNode(true)));
  const places = names.map((name) => drives.findIndex((drive) => drive.name === name));
  const [first, second] = places.length === 2 && !places.includes(-1) ? places : [0, 1];
  Object.assign(one, { value: String(first) });
  Object.assign(two, { value: String(second) });
}

// A row for each drive: shown or not, followed or not, and what it does at the cursor.
function fillDrives(list, drives, toggle, follow) {
  const rows = new Map();
  const items = drives.map((drive) => {
    const chip = element(
      "button",
      { type: "button", class: "chip", "aria-pressed": "true", title: "Show or hide", onclick: () => toggle(drive) },
      numberBadge(drive), lineSample(drive), element("span", { class: "name" }, drive.name),
    );
    const several = drives.length > 1;
    const lead = element(
      "button",
      {
        type: "button", class: "lead", "aria-pressed": "false", "aria-label": `Follow ${drive.name}`,
        title: "Follow this one", onclick: () => follow(drive),
      },
      "◎",
    );
    const values = element("span", { class: "values" });
    rows.set(drive, { chip, lead, values });
    return element("li", {}, element("span", { class: "who" }, chip, ...(several ? [lead] : [])), values);
  });
  list.replaceChildren(...items);
  return rows;
}

const STATES = { 1: "clipped", 2: "fallback" };

function doing(drive, row) {
  const helped = (mark) => mark.kind === "intervention" && mark.row <= row && row <= mark.until;
  return drive.marks.some(helped) ? "supervisor" : STATES[drive.status[row]];
}

function valuesAt(drive, state) {
  const row = drive.row(state.axis, state.cursor);
  if (!drive.length) return "nothing recorded";
  const d = drive.value("lateral_error", row);
  const side = Math.abs(d) < 0.05 ? "" : d > 0 ? " left" : " right";
  const words = [
    `${drive.value("speed", row).toFixed(1)} m/s`,
    `${number(Math.abs(d))} mm${side}`,
    `steer ${number(drive.value("steer", row), 2)}`,
  ];
  if (drive.over(state.axis, state.cursor)) words.push(drive.completed ? "finished" : drive.end);
  else words.push(...[doing(drive, Math.floor(row))].filter(Boolean));
  return words.join(" · ");
}

function fillSignals(box, signals, shown, changed) {
  box.replaceChildren(...signals.map((signal) => {
    const input = element("input", { type: "checkbox" });
    input.checked = shown.has(signal.key);
    input.addEventListener("change", () => {
      if (input.checked) shown.add(signal.key);
      else shown.delete(signal.key);
      changed();
    });
    return element("label", {}, input, ` ${signal.title}`);
  }));
}

function fillLegend(list, kinds) {
  const items = kinds.map((kind) => element("li", {}, glyphPicture(kind, ""), KINDS[kind]));
  list.replaceChildren(...items);
}

// Of a crowd, so many drives are shown at first.
const CROWD = 6;

// What a reader has to know of what is shown, and of what is not.
function remarks(group, drives, hidden) {
  const words = [`Corridor ±${number(group.half)} m.`];
  if (!drives.some((drive) => drive.seen)) words.push("What the controllers saw of the road is not known here.");
  if (!drives.every((drive) => drive.car.known)) words.push("The vehicle is not recorded: drawn is the default one.");
  if (!drives.every((drive) => drive.kept)) words.push("Long drives are thinned: every peak is kept, not every step.");
  if (hidden.size) words.push(`Of ${drives.length} drives ${CROWD} are shown: click the names of others.`);
  return words.join(" ");
}
