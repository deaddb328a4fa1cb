// Round numbers for axes, and numbers as text.

const DASHES = { solid: [], dash: [7, 4], dot: [2, 3], dashdot: [7, 3, 2, 3] };

function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

function roundStep(span, count) {
  const raw = span / Math.max(count, 1);
  const size = 10 ** Math.floor(Math.log10(raw));
  return size * [1, 2, 5, 10].find((factor) => size * factor >= raw * 0.999);
}

function ticks(low, high, count) {
  if (!(high > low)) return [];
  const step = roundStep(high - low, count);
  const out = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k++) out.push(k * step);
  return out;
}

// Ticks of a low panel: about so many, and never fewer than two.
function fewTicks(low, high, count) {
  const found = ticks(low, high, count);
  return found.length > 1 ? found : ticks(low, high, 2 * count);
}

// Ticks of a logarithmic axis from 10^low to 10^high: 1, 2, 5 of every decade if it is short, even
// steps within one decade.
function logTicks(low, high, count) {
  if (high - low <= 1) return ticks(10 ** low, 10 ** high, count);
  const factors = high - low > count ? [1] : high - low > count / 3 ? [1, 3] : [1, 2, 5];
  const out = [];
  for (let k = Math.floor(low); k <= high; k++) {
    for (const factor of factors) {
      const value = Math.log10(factor) + k;
      if (value >= low - 1e-9 && value <= high + 1e-9) out.push(factor * 10 ** k);
    }
  }
  return out;
}

function number(value, digits = 3) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-4 || size >= 1e6)) return value.toExponential(digits - 1).replace("-", "−");
  const text = size >= 10 ** digits ? value.toFixed(0) : String(Number(value.toPrecision(digits)));
  return text.replace("-", "−");
}

// A number for a tick: as many decimals as the step between ticks needs.
function tickText(value, step) {
  if (value !== 0 && (Math.abs(value) >= 1e5 || step < 1e-4)) return number(value, 2);
  const decimals = clamp(-Math.floor(Math.log10(step) + 1e-9), 0, 6);
  return value.toFixed(decimals).replace("-", "−");
}

// Red, green and blue of "#rrggbb" from 0 to 1.
function channels(color) {
  return [1, 3, 5].map((at) => parseInt(color.slice(at, at + 2), 16) / 255);
}

// Relative luminance (WCAG 2.2).
function luminance(rgb) {
  const [r, g, b] = rgb.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

// The colour, lighter on dark and darker on light pages until it stands out. Light pages ask for
// less: darker, the two blues and the two oranges of the palette would look alike.
function visible(color, paper) {
  const back = luminance(channels(paper));
  const goal = back > 0.2 ? 0 : 1;
  let rgb = channels(color);
  for (let k = 0; k < 20; k++) {
    const own = luminance(rgb);
    if ((Math.max(own, back) + 0.05) / (Math.min(own, back) + 0.05) >= (goal ? 3.2 : 2)) break;
    rgb = rgb.map((c) => c + (goal - c) * 0.08);
  }
  return `#${rgb.map((c) => Math.round(255 * c).toString(16).padStart(2, "0")).join("")}`;
}

// Makes a canvas as fine as the screen; returns its context, in pixels of the page.
function sized(canvas) {
  const ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = canvas.clientWidth;
  const height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height, ratio };
}

function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value !== null) node.setAttribute(name, value);
  }
  // Strings become text, never HTML: names come from users' files.
  node.append(...children);
  return node;
}
