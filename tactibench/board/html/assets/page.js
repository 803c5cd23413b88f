"use strict";
(() => {
  const root = document.documentElement;
  const byId = (id) => document.getElementById(id);
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const say = (text) => { byId("said").textContent = text; };
  const specs = JSON.parse(byId("figures").textContent);

  // ---- light and dark -------------------------------------------------------------------------
  const themes = ["system", "light", "dark"];
  const remembered = () => { try { return localStorage.getItem("tactibench-theme"); } catch { return null; } };
  const remember = (name) => { try { localStorage.setItem("tactibench-theme", name); } catch { /* no storage for files */ } };
  let theme = themes.includes(remembered()) ? remembered() : "system";
  const showTheme = () => {
    if (theme === "system") delete root.dataset.theme; else root.dataset.theme = theme;
    byId("theme").textContent = `Theme: ${theme}`;
    repaint();
  };

  // ---- tables ---------------------------------------------------------------------------------
  const key = (row, column, numeric) => {
    const cell = row.cells[column];
    if (!cell) return null;
    if (numeric) return cell.dataset.v === undefined ? null : Number(cell.dataset.v);
    return cell.textContent.trim().toLowerCase();
  };
  const compare = (a, b) => (typeof a === "number" ? a - b : a.localeCompare(b, "en", { numeric: true }));
  const sort = (table, column, head) => {
    const ascending = head.getAttribute("aria-sort") !== "ascending";
    const body = table.tBodies[0];
    const rows = [...body.rows];
    const numeric = head.classList.contains("n");
    const known = rows.map((row) => [key(row, column, numeric), row]);
    known.sort(([a], [b]) => {
      if (a === null || b === null) return (a === null) - (b === null); // without a number: last
      return ascending ? compare(a, b) : compare(b, a);
    });
    body.append(...known.map(([, row]) => row));
    all("th", table.tHead).forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", ascending ? "ascending" : "descending");
    say(`sorted by ${head.title || head.textContent.trim()}, ${ascending ? "ascending" : "descending"}`);
  };
  all("table.board").forEach((table) => {
    if (!table.tBodies.length || table.tBodies[0].rows.length < 2) return;
    [...table.tHead.rows[0].cells].forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      if (head.title) button.setAttribute("aria-label", head.title);
      head.append(button);
      button.addEventListener("click", () => sort(table, column, head));
    });
  });
  all("input[data-filter]").forEach((input) => {
    const chapter = byId(input.dataset.filter);
    input.addEventListener("input", () => {
      const words = input.value.toLowerCase().split(/[\s,]+/).filter(Boolean);
      let shown = 0;
      all(".tables table.board", chapter).forEach((table) => [...table.tBodies[0].rows].forEach((row) => {
        const text = row.textContent.toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
        shown += !row.hidden;
      }));
      say(`${shown} rows shown`);
    });
  });

  // ---- figures --------------------------------------------------------------------------------
  const colour = (name) => getComputedStyle(root).getPropertyValue(name).trim();
  const axisLook = () => ({ gridcolor: colour("--grid"), linecolor: colour("--soft"), zeroline: false, ticks: "outside", tickcolor: colour("--line") });
  const themed = (layout) => {
    const made = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", showlegend: false, hovermode: "closest",
      dragmode: false, margin: { l: 56, r: 14, t: 12, b: 46 },
      hoverlabel: { bgcolor: colour("--paper"), bordercolor: colour("--soft"), font: { family: colour("--font"), size: 13, color: colour("--ink") }, align: "left" },
      ...layout,
    };
    made.font = { family: colour("--font"), size: 13, color: colour("--ink"), ...layout.font };
    const look = axisLook();
    for (const name of ["xaxis", "yaxis"]) if (layout[name]) {
      made[name] = { ...look, ...layout[name] };
    }
    if (layout.scene) {
      const ground = { gridcolor: colour("--line"), showbackground: false, zeroline: false };
      made.scene = { ...layout.scene };
      for (const name of ["xaxis", "yaxis", "zaxis"]) made.scene[name] = { ...ground, ...layout.scene[name] };
      made.dragmode = "turntable";
      made.margin = { l: 0, r: 0, t: 0, b: 0 };
    }
    return made;
  };
  const config = { displayModeBar: false, responsive: true, displaylogo: false, scrollZoom: false };
  const drawn = new Set();
  let library = null;
  const inView = (div) => div.offsetParent !== null && div.clientWidth > 0;
  const draw = async (div) => {
    if (drawn.has(div) || !inView(div)) return;
    drawn.add(div);
    const spec = specs[div.dataset.figure];
    await library;
    await window.Plotly.newPlot(div, spec.data, themed(spec.layout), config);
    chips(div, spec);
    div.addEventListener("keydown", (event) => step(div, event));
    div.dataset.drawn = "1";
  };
  function repaint() {
    drawn.forEach((div) => {
      if (div.dataset.drawn) window.Plotly.react(div, div.data, themed(specs[div.dataset.figure].layout), config);
    });
  }

  // ---- legend: one button a row, in words, shape and dash -------------------------------------
  const glyphs = { circle: "●", square: "■", "triangle-up": "▲", diamond: "◆", "triangle-down": "▼", cross: "✚", x: "✖" };
  const hollow = { "●": "○", "■": "□", "▲": "△", "◆": "◇", "▼": "▽", "✚": "✛", "✖": "✕" };
  const plainText = (text) => text.replaceAll("&lt;", "<").replaceAll("&gt;", ">").replaceAll("&amp;", "&").replaceAll("\u200b", "");
  const swatch = (trace) => {
    const made = document.createElement("span");
    made.className = "swatch";
    made.style.color = trace.marker.color;
    made.setAttribute("aria-hidden", "true");
    const symbol = String([trace.marker.symbol].flat()[0]);
    const glyph = glyphs[symbol.replace("-open", "")] ?? "●";
    made.append(symbol.endsWith("-open") && trace.mode === "markers" ? hollow[glyph] : glyph);
    if (trace.line) {
      const line = document.createElement("i");
      if (trace.line.dash !== "solid") line.className = trace.line.dash.startsWith("dash") ? "dash" : "dot";
      made.append(line);
    }
    return made;
  };
  function chips(div, spec) {
    const place = document.querySelector(`[data-chips="${div.dataset.figure}"]`);
    const named = spec.data.map((trace, k) => [trace, k]).filter(([trace]) => trace.name && trace.showlegend !== false && trace.marker);
    if (named.length < 2) return;
    named.forEach(([trace, k]) => {
      const button = document.createElement("button");
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      button.append(swatch(trace), plainText(trace.name));
      const group = spec.data.map((other, j) => [other, j]).filter(([other, j]) => j === k || (trace.legendgroup && other.legendgroup === trace.legendgroup)).map(([, j]) => j);
      button.addEventListener("click", () => {
        const show = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", String(show));
        window.Plotly.restyle(div, { visible: show }, group);
      });
      place.append(button);
    });
  }

  // ---- the points of a figure, by keyboard ----------------------------------------------------
  const points = (div) => div.data.flatMap((trace, curve) => {
    if (trace.visible === false || trace.hoverinfo === "skip" || trace.type === "surface") return [];
    if (trace.type === "heatmap") return trace.customdata.flatMap((line, j) => line.map((cell, i) => ({ curveNumber: curve, pointNumber: [j, i], text: cell[3] ? `${trace.x[i]}, ${trace.y[j]}: ${cell[0]} [${cell[1]}], ${cell[2]} % missed` : "" })));
    if (!trace.hovertext) return [];
    return trace.hovertext.map((text, k) => ({ curveNumber: curve, pointNumber: k, text }));
  });
  function step(div, event) {
    const moves = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 };
    if (event.key === "Escape") { window.Plotly.Fx.unhover(div); return; }
    if (!(event.key in moves)) return;
    event.preventDefault();
    const known = points(div).filter((point) => point.text);
    if (!known.length) return;
    const before = Number(div.dataset.point ?? (moves[event.key] > 0 ? -1 : 0));
    const at = (before + moves[event.key] + known.length) % known.length;
    div.dataset.point = at;
    const { curveNumber, pointNumber, text } = known[at];
    window.Plotly.Fx.hover(div, [{ curveNumber, pointNumber }]);
    say(plainText(text.replaceAll("<br>", ", ").replaceAll(/<\/?b>/g, "")));
  }

  // ---- choices --------------------------------------------------------------------------------
  all("select[data-options]").forEach((select) => {
    const options = all(`[data-of="${select.dataset.options}"]`);
    const show = () => {
      options.forEach((option) => { option.hidden = option.dataset.option !== select.value; });
      options.filter((option) => !option.hidden).forEach((option) => all(".plot", option).forEach(draw));
    };
    select.addEventListener("change", show);
    if (select.value !== "0") show(); // a browser may restore what was chosen
  });

  // ---- the library, unpacked once the tables can be read --------------------------------------
  const bytes = (text) => {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const signs = atob(text);
    const made = new Uint8Array(signs.length);
    for (let k = 0; k < signs.length; k += 1) made[k] = signs.charCodeAt(k);
    return made;
  };
  const unpack = async () => {
    const packed = bytes(byId("library").textContent.trim());
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
    byId("library").remove();
    if (!window.Plotly) throw new Error("the plotting library did not start");
  };
  const failed = (error) => {
    root.dataset.failed = String(error);
    all(".plot").forEach((div) => { div.textContent = "Figures need a browser of 2023 or newer; the numbers stand below and in the tables."; div.style.height = "auto"; });
  };
  const start = () => {
    if (!all(".plot").length) { root.dataset.ready = "1"; return; }
    library = unpack();
    const seen = new IntersectionObserver((entries) => entries.forEach((entry) => { if (entry.isIntersecting) draw(entry.target).catch(failed); }), { rootMargin: "300px" });
    all(".plot").forEach((div) => seen.observe(div));
    library.then(() => { root.dataset.ready = "1"; }).catch(failed);
  };

  const here = new IntersectionObserver((entries) => entries.forEach((entry) => {
    const link = document.querySelector(`nav a[href="#${entry.target.id}"]`);
    link.classList.toggle("here", entry.isIntersecting);
    if (entry.isIntersecting) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current");
  }), { rootMargin: "-20% 0px -70% 0px" });
  all("section.chapter").forEach((chapter) => here.observe(chapter));

  byId("theme").addEventListener("click", () => {
    theme = themes[(themes.indexOf(theme) + 1) % themes.length];
    remember(theme);
    showTheme();
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (theme === "system") repaint(); });
  showTheme();
  requestAnimationFrame(() => setTimeout(start, 0));
})();
