// Curves over window end, lead time, SNR or false alarms, drawn by plotly.js, which the page holds packed in #plotly.
// Each reads the JSON beside it, which `evaluation/report/html/charts.py` describes. Where a browser cannot unpack the
// library, the pictures stay.
"use strict";
(() => {
  const SYMBOLS = ["circle", "square", "triangle-up", "diamond", "x", "star"];
  const LETTERS = ["●", "■", "▲", "◆", "✖", "★"]; // The same in the legend.
  const DASHES = ["solid", "dash", "dot", "dashdot", "longdash", "longdashdot"];
  const TURN = 6; // Colours; with more lines than these, the dash tells them apart.
  const charts = [...document.querySelectorAll(".chart")].map((box) => ({
    box,
    plot: box.querySelector(".plot"),
    reading: box.querySelector(".reading"),
    legend: box.querySelector(".legend"),
    off: new Set(), // Names of lines that are not shown.
    data: JSON.parse(box.querySelector("script").textContent),
    line: 0,
    point: -1,
  }));

  async function library() {
    const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
  }

  function colours() {
    const style = getComputedStyle(document.documentElement), of = (name) => style.getPropertyValue(`--${name}`).trim();
    const names = ["text", "soft", "line", "page", "panel"];
    const found = Object.fromEntries(names.map((name) => [name, of(name)]));
    found.lines = SYMBOLS.map((_, k) => of(`class-${k}`));
    found.size = Number.parseFloat(style.fontSize) || 16;
    return found;
  }

  // Plotly reads some HTML in its texts.
  const escaped = (text) => text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");

  // The names of the lines in their order: each has one colour, dash and mark in all panels.
  const namesOf = (data) => [...new Set(data.lines.map((line) => line.name))];

  function traces({ data, off }, shades) {
    const names = namesOf(data), many = names.length > TURN, grown = shades.size / 16;
    return data.lines.map((line) => {
      const which = names.indexOf(line.name), colour = shades.lines[which % TURN];
      const turn = many ? Math.floor(which / TURN) : which;
      return {
        type: "scatter",
        visible: !off.has(line.name),
        x: data.log ? line.x.map((x) => Math.max(x, data.ranges[0][0] / 10)) : line.x, // 0 lies left of the axis.
        customdata: line.x,
        y: line.y,
        yaxis: line.panel ? `y${line.panel + 1}` : "y",
        mode: line.single ? "markers" : "lines+markers",
        line: { color: colour, width: 2 * grown, dash: DASHES[turn % DASHES.length], shape: data.stairs ? "hv" : "linear" },
        marker: {
          color: line.hollow.map((hollow) => (hollow ? shades.page : colour)),
          symbol: SYMBOLS[which % SYMBOLS.length],
          size: (line.single ? 14 : 7) * grown,
          line: { color: line.single ? shades.text : colour, width: line.single ? 1.5 : 1.2 },
          maxdisplayed: line.single ? 0 : 40,
        },
        meta: escaped(line.name),
        hovertemplate: "%{meta}: %{y:.3f} at %{customdata}<extra></extra>",
      };
    });
  }

  function layout(data, shades) {
    const panels = data.y.length, gap = 0.12, height = (1 - gap * (panels - 1)) / panels, [xRange, yRange] = data.ranges;
    const axis = { gridcolor: shades.line, linecolor: shades.soft, zeroline: false, ticks: "outside", tickcolor: shades.soft };
    const range = xRange && (data.log ? xRange.map(Math.log10) : xRange);
    const found = {
      paper_bgcolor: "rgba(0,0,0,0)",
      plot_bgcolor: "rgba(0,0,0,0)",
      font: { family: "system-ui, sans-serif", size: 0.8 * shades.size, color: shades.text },
      margin: { l: 2.6 * shades.size, r: shades.size, t: 2 * shades.size, b: 3.2 * shades.size },
      height: (panels > 1 ? 32 : 22) * shades.size,
      showlegend: false,
      dragmode: window.matchMedia("(pointer: coarse)").matches ? false : "zoom",
      hovermode: "closest",
      hoverlabel: { bgcolor: shades.panel, font: { color: shades.text }, bordercolor: shades.soft },
      xaxis: {
        ...axis,
        title: { text: escaped(data.x), font: { size: 0.8 * shades.size } },
        type: data.log ? "log" : "linear",
        anchor: panels > 1 ? `y${panels}` : "y",
        ...(range && { range: data.backwards ? [range[1], range[0]] : range }),
        ...(!range && data.backwards && { autorange: "reversed" }),
        ...(data.log && { dtick: 1 }),
      },
      shapes: [],
      annotations: [],
    };
    const note = { showarrow: false, yref: "paper", font: { color: shades.soft } };
    data.y.forEach((title, k) => {
      const top = 1 - k * (height + gap);
      found[k ? `yaxis${k + 1}` : "yaxis"] = {
        ...axis,
        domain: [Math.max(top - height, 0), top],
        ...(yRange && { range: yRange }),
      };
      found.annotations.push({ ...note, text: escaped(title), xref: "paper", x: 0, xanchor: "left", y: top, yanchor: "bottom", font: { color: shades.text } });
    });
    const line = { color: shades.soft, width: 1.5, dash: "dash" };
    if (data.guide) {
      const [at, text] = data.guide;
      found.shapes.push({ type: "line", x0: at, x1: at, y0: 0, y1: 1, yref: "paper", line });
      found.annotations.push({ ...note, x: at, xanchor: "left", y: 0, yanchor: "bottom", text: escaped(text) });
    }
    if (data.diagonal) {
      found.shapes.push({ type: "line", x0: 0, x1: 1, y0: 0, y1: 1, line: { ...line, dash: "dot" } });
      found.annotations.push({ ...note, x: 0.5, xanchor: "left", yref: "y", y: 0.5, yanchor: "top", text: escaped(data.diagonal) });
    }
    return found;
  }

  function draw(chart) {
    const shades = colours();
    return Plotly.react(chart.plot, traces(chart, shades), layout(chart.data, shades), {
      displayModeBar: false,
      responsive: true,
    });
  }

  // A button for each line, which shows it or not.
  function drawLegend(chart) {
    const shades = colours();
    chart.legend.replaceChildren(
      ...namesOf(chart.data).map((name, which) => {
        const item = document.createElement("li"), button = document.createElement("button"), sign = document.createElement("span");
        sign.textContent = `${LETTERS[which % TURN]}${which < TURN ? "" : "┄"} `;
        sign.style.color = shades.lines[which % TURN];
        sign.setAttribute("aria-hidden", "true");
        button.type = "button";
        button.append(sign, name);
        button.setAttribute("aria-pressed", String(!chart.off.has(name)));
        button.addEventListener("click", () => {
          if (!chart.off.delete(name)) chart.off.add(name);
          button.setAttribute("aria-pressed", String(!chart.off.has(name)));
          draw(chart);
        });
        item.append(button);
        return item;
      }),
    );
  }

  // Reads a point aloud, and shows it as the pointer would.
  function read(chart, line, point) {
    const { lines, y, x } = chart.data;
    chart.line = (line + lines.length) % lines.length;
    const shown = lines[chart.line];
    chart.point = Math.min(Math.max(point, 0), shown.x.length - 1);
    if (chart.off.has(shown.name)) Plotly.Fx.unhover(chart.plot);
    else Plotly.Fx.hover(chart.plot, [{ curveNumber: chart.line, pointNumber: chart.point }], shown.panel ? [`xy${shown.panel + 1}`] : ["xy"]);
    const [at, value] = [shown.x[chart.point], shown.y[chart.point]];
    chart.reading.textContent = `${shown.name}: ${y[shown.panel]} ${value.toFixed(3)} (${x}: ${at})`;
  }

  function reachable(chart) {
    const step = chart.data.backwards ? -1 : 1;
    const keys = {
      ArrowLeft: () => read(chart, chart.line, chart.point < 0 ? 0 : chart.point - step),
      ArrowRight: () => read(chart, chart.line, chart.point < 0 ? 0 : chart.point + step),
      ArrowUp: () => read(chart, chart.line - 1, chart.point),
      ArrowDown: () => read(chart, chart.line + 1, chart.point),
      Escape: () => { Plotly.Fx.unhover(chart.plot); chart.reading.textContent = ""; },
    };
    chart.box.addEventListener("keydown", (event) => {
      if (event.target !== chart.box || event.ctrlKey || event.metaKey || event.altKey || !(event.key in keys)) return;
      event.preventDefault();
      keys[event.key]();
    });
  }

  async function show(chart) {
    await (loading ??= library());
    chart.box.hidden = false;
    try {
      await draw(chart);
      drawLegend(chart);
      chart.box.parentElement.querySelector("img").hidden = true;
      reachable(chart);
    } catch {
      chart.box.hidden = true;
    }
  }

  // The library takes a moment: it is unpacked when the first curve comes near, not while the page opens.
  let loading = null;
  const coming = new IntersectionObserver((seen) => {
    for (const { target, isIntersecting } of seen) {
      if (!isIntersecting) continue;
      coming.unobserve(target);
      show(charts.find((chart) => chart.box.parentElement === target)).catch(() => {});
    }
  }, { rootMargin: "50% 0px" });
  for (const chart of charts) coming.observe(chart.box.parentElement);
  const repaint = () => charts.filter((chart) => !chart.box.hidden).forEach((chart) => { draw(chart); drawLegend(chart); });
  document.addEventListener("theme-change", repaint);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
})();
