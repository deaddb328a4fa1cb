"use strict";
(async () => {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const narrow = matchMedia("(max-width: 860px)");

  async function unpack(id) {
    const packed = atob(document.getElementById(id).textContent.trim());
    const bytes = Uint8Array.from(packed, (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }

  function complain(text) {
    const notice = document.getElementById("notice");
    notice.textContent = text;
    notice.hidden = false;
  }

  if (!("DecompressionStream" in window)) {
    complain("This browser is too old for the plots (they need one of 2023 or later).");
    return;
  }
  const library = document.createElement("script");
  library.textContent = await unpack("library");
  document.head.append(library);
  const data = JSON.parse(await unpack("data"));
  // Nothing may leave the machine: the library's button that uploads a plot is on by default.
  const config = { responsive: true, displaylogo: false, showSendToCloud: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] };

  const theme = () => {
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(name).trim();
    return { ink: read("--ink"), soft: read("--soft"), line: read("--line"), panel: read("--panel") };
  };

  function base(colors) {
    return {
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: colors.ink, size: 12, family: getComputedStyle(document.body).fontFamily },
      showlegend: false,
      hoverlabel: { bgcolor: colors.panel, bordercolor: colors.line, font: { color: colors.ink }, namelength: 40 },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colors.soft, activecolor: colors.ink },
    };
  }

  const axis = (colors, more) => ({
    gridcolor: colors.line, zerolinecolor: colors.soft, linecolor: colors.line,
    automargin: true, ...more,
  });

  const heading = (colors, text, x, y) => ({
    text, x, y, xref: "paper", yref: "paper", xanchor: "left", yanchor: "bottom",
    showarrow: false, font: { size: 12, color: colors.ink },
  });

  const line = (run, width) => ({ color: run.color, dash: run.dash, width });

  function drawPath(node, group, state) {
    const colors = theme();
    const faint = (x, y, name, style, visible) => ({
      x, y, name, visible, mode: "lines", hoverinfo: "skip", line: { color: colors.soft, width: 1, dash: style },
    });
    const path = group.path;
    const traces = [
      faint(path.x, path.y, "path", "solid", true),
      faint(path.left_x, path.left_y, "corridor", "dot", state.corridor),
      faint(path.right_x, path.right_y, "corridor", "dot", state.corridor),
      ...group.runs.map((run, k) => ({
        x: run.x, y: run.y, name: run.name, mode: "lines", line: line(run, 2), visible: !state.hidden.has(k),
        customdata: run.lateral.map((d, i) => [run.time[i], d]),
        hovertemplate: "t %{customdata[0]} s, lateral error %{customdata[1]} mm<br>x %{x} m, y %{y} m",
      })),
      {
        x: path.x.slice(0, 1), y: path.y.slice(0, 1), mode: "markers+text", text: ["start"], hoverinfo: "skip",
        textposition: "bottom right", marker: { color: colors.ink, size: 8, symbol: "diamond" },
      },
    ];
    const layout = {
      ...base(colors), uirevision: "path", hovermode: "closest", dragmode: "pan",
      margin: { l: 44, r: 8, t: 26, b: 40 },
      xaxis: axis(colors, { title: { text: "x [m]" }, zeroline: false }),
      yaxis: axis(colors, { title: { text: "y [m]" }, zeroline: false, scaleanchor: "x" }),
    };
    Plotly.react(node, traces, layout, { ...config, scrollZoom: true });
  }

  function drawSignals(node, group, state) {
    const colors = theme();
    const n = data.panels.length;
    const gap = 0.045;
    const height = (1 - gap * n) / n;
    const layout = {
      ...base(colors), uirevision: state.axis, annotations: [], margin: { l: 52, r: 8, t: 8, b: 40 },
      hovermode: group.runs.length > 6 ? "closest" : "x unified",
      xaxis: axis(colors, {
        title: { text: state.axis === "time" ? "time [s]" : "distance along the path [m]" },
        anchor: n > 1 ? "y" + n : "y", zeroline: false,
      }),
    };
    const traces = [];
    data.panels.forEach((panel, p) => {
      const id = p ? String(p + 1) : "";
      const top = 1 - gap - p * (height + gap);
      layout["yaxis" + id] = axis(colors, { domain: [Math.max(top - height, 0), top], nticks: 5 });
      layout.annotations.push(heading(colors, panel.title, 0, top));
      group.runs.forEach((run, k) => traces.push({
        x: run[state.axis], y: run[panel.key], yaxis: "y" + id, name: run.name, mode: "lines",
        line: line(run, 1.5), visible: !state.hidden.has(k),
      }));
    });
    Plotly.react(node, traces, layout, config);
  }

  function drawTraining(node, state) {
    const colors = theme();
    const training = data.training;
    const n = training.panels.length;
    const columns = Math.min(narrow.matches ? 1 : 3, n);
    const rows = Math.ceil(n / columns);
    const gapX = 0.06, pixels = 230;
    const gapY = 56 / (rows * pixels);
    const width = (1 - gapX * (columns - 1)) / columns;
    const height = 1 / rows - gapY;
    const layout = {
      ...base(colors), uirevision: String(state.log) + columns, annotations: [], height: rows * pixels + 40,
      margin: { l: 52, r: 8, t: 8, b: 32 }, hovermode: training.runs.length > 6 ? "closest" : "x unified",
    };
    const traces = [];
    training.panels.forEach((title, p) => {
      const id = p ? String(p + 1) : "";
      const left = (p % columns) * (width + gapX);
      const bottom = 1 - (Math.floor(p / columns) + 1) / rows + gapY * 0.5;
      const last = p + columns >= n;
      layout["xaxis" + id] = axis(colors, {
        domain: [left, Math.min(left + width, 1)], anchor: "y" + id, zeroline: false, nticks: 6,
        title: last ? { text: training.x, standoff: 4 } : undefined, ...(p ? { matches: "x" } : {}),
      });
      layout["yaxis" + id] = axis(colors, {
        domain: [bottom, bottom + height], anchor: "x" + id, nticks: 6, type: state.log ? "log" : "linear",
        exponentformat: "power",
      });
      layout.annotations.push(heading(colors, title, left, bottom + height));
      training.runs.forEach((run, k) => {
        const curve = run.panels[p];
        traces.push({
          x: curve.x, y: curve.y, xaxis: "x" + id, yaxis: "y" + id, name: run.name, line: line(run, 1.5),
          mode: curve.x.length > 40 ? "lines" : "lines+markers", marker: { color: run.color, size: 5 },
          visible: !state.hidden.has(k),
        });
      });
    });
    Plotly.react(node, traces, layout, config);
  }

  // Sections are drawn when they come near the screen, and again when an option changes.
  const seen = new Set();
  const sections = new Map();
  const observer = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (entry.isIntersecting && !seen.has(entry.target)) {
        seen.add(entry.target);
        sections.get(entry.target)();
      }
    }
  }, { rootMargin: "600px" });
  const redraw = () => seen.forEach((section) => sections.get(section)());

  function prepare(section, draw) {
    const state = { hidden: new Set(), axis: "time", corridor: false, log: false };
    const again = () => draw(section, state);
    for (const chip of section.querySelectorAll(".chip")) {
      chip.addEventListener("click", () => {
        const k = Number(chip.dataset.run);
        const shown = state.hidden.delete(k) || !state.hidden.add(k);
        chip.setAttribute("aria-pressed", String(shown));
        again();
      });
    }
    const on = (query, name, read) => section.querySelector(query)?.addEventListener("change", (event) => {
      state[name] = read(event.target);
      again();
    });
    on(".axis", "axis", (input) => input.value);
    on(".corridor", "corridor", (input) => input.checked);
    on(".log", "log", (input) => input.checked);
    sections.set(section, again);
    observer.observe(section);
  }

  for (const section of document.querySelectorAll(".drive")) {
    const group = data.groups[Number(section.dataset.group)];
    prepare(section, (node, state) => {
      drawPath(node.querySelector(".path"), group, state);
      drawSignals(node.querySelector(".signals"), group, state);
    });
  }
  for (const node of document.querySelectorAll(".curves")) {
    prepare(node.closest("section"), (section, state) => drawTraining(node, state));
  }
  dark.addEventListener("change", redraw);
  narrow.addEventListener("change", redraw);
})();
