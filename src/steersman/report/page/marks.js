// Marks: moments to jump to. Each kind has a shape of its own, so colour is not needed to tell them.

const KINDS = {
  end: "ended early",
  worst: "largest |d|",
  fault: "something breaks on purpose",
  friction: "road with other friction",
  intervention: "supervisor stepped in",
  fallback: "controller's fallback",
  saturated: "command clipped",
};

function drawGlyph(context, kind, px, py, size, color) {
  context.beginPath();
  if (kind === "worst") {
    context.moveTo(px, py - size);
    context.lineTo(px + size, py + size * 0.8);
    context.lineTo(px - size, py + size * 0.8);
    context.closePath();
  } else if (kind === "friction") {
    for (let k = 0; k < 6; k++) {
      context.lineTo(px + size * Math.sin((k * Math.PI) / 3), py - size * Math.cos((k * Math.PI) / 3));
    }
    context.closePath();
  } else if (kind === "saturated") {
    context.rect(px - size * 0.7, py - size * 0.7, size * 1.4, size * 1.4);
  } else if (kind === "fallback") {
    context.moveTo(px, py - size);
    context.lineTo(px + size, py);
    context.lineTo(px, py + size);
    context.lineTo(px - size, py);
    context.closePath();
  } else if (kind === "fault") {
    for (let k = 0; k < 10; k++) {
      const reach = k % 2 ? 0.45 * size : 1.1 * size;
      context.lineTo(px + reach * Math.sin((k * Math.PI) / 5), py - reach * Math.cos((k * Math.PI) / 5));
    }
    context.closePath();
  } else if (kind === "intervention") {
    context.arc(px, py, size, 0, 2 * Math.PI);
  } else {
    context.moveTo(px - size, py - size);
    context.lineTo(px + size, py + size);
    context.moveTo(px + size, py - size);
    context.lineTo(px - size, py + size);
    for (const [width, stroke] of [[5.5, theme.colors.ink], [3, color]]) {
      context.lineWidth = width;
      context.strokeStyle = stroke;
      context.stroke();
    }
    return;
  }
  context.fillStyle = color;
  context.fill();
  context.lineWidth = 1.3;
  context.strokeStyle = theme.colors.ink;
  context.stroke();
}

// A glyph as a small picture beside words.
function glyphPicture(kind, color) {
  const canvas = element("canvas", { class: "glyph", "aria-hidden": "true" });
  canvas.width = canvas.height = 32;
  const context = canvas.getContext("2d");
  context.scale(2, 2);
  drawGlyph(context, kind, 8, 8, 5.5, color || theme.colors.soft);
  return canvas;
}

function clock(seconds) {
  return `${seconds.toFixed(1)} s`;
}

// Marks of drives in the order of their kinds' weight.
function sortedMarks(drives) {
  const weight = Object.keys(KINDS);
  const marks = drives.flatMap((drive) => drive.marks);
  return marks.sort((a, b) => weight.indexOf(a.kind) - weight.indexOf(b.kind));
}

function markTime(mark) {
  return mark.drive.time[mark.row];
}

// The mark that comes next after the cursor (direction 1), or came last before it (-1).
function nextMark(drives, { axis, cursor }, direction) {
  const at = (mark) => mark.drive[axis][mark.row];
  const marks = drives.flatMap((drive) => drive.marks);
  const ahead = marks.filter((mark) => (at(mark) - cursor) * direction > 1e-6);
  return ahead.sort((a, b) => (at(a) - at(b)) * direction)[0];
}

function fillMoments(list, drives, jump) {
  const items = sortedMarks(drives).map((mark) => {
    const several = drives.length > 1 ? [numberBadge(mark.drive)] : [];
    const more = mark.of ? ` (the longest of ${mark.of})` : "";
    const button = element(
      "button",
      { type: "button", class: "moment", "data-kind": mark.kind, onclick: () => jump(mark) },
      glyphPicture(mark.kind, mark.drive.color), ...several,
      element("span", { class: "at" }, clock(markTime(mark))),
      element("span", {}, mark.text + more),
    );
    return element("li", {}, button);
  });
  list.replaceChildren(...items);
  return items.length;
}

function numberBadge(drive) {
  const badge = element("span", { class: "badge", title: drive.name }, String(drive.number));
  badge.style.borderColor = drive.color;
  return badge;
}

// The colour and dash of a drive as a line beside words.
function lineSample(drive) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("width", "28");
  svg.setAttribute("height", "8");
  svg.setAttribute("aria-hidden", "true");
  const line = document.createElementNS("http://www.w3.org/2000/svg", "path");
  line.setAttribute("d", "M1 4h26");
  line.setAttribute("stroke", drive.color);
  line.setAttribute("stroke-width", "3");
  line.setAttribute("stroke-dasharray", drive.dash.join(" ") || "none");
  svg.append(line);
  return svg;
}
