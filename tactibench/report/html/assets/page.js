"use strict";
(() => {
  const root = document.documentElement;
  const byId = (id) => document.getElementById(id);
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const say = (text) => { byId("said").textContent = text; };

  // ---- light and dark -------------------------------------------------------------------------
  const themes = ["system", "light", "dark"];
  const remembered = () => { try { return localStorage.getItem("tactibench-theme"); } catch { return null; } };
  const remember = (name) => { try { localStorage.setItem("tactibench-theme", name); } catch { /* no storage for files */ } };
  let theme = themes.includes(remembered()) ? remembered() : "system";
  const showTheme = () => {
    if (theme === "system") delete root.dataset.theme; else root.dataset.theme = theme;
    byId("theme").textContent = `Theme: ${theme}`;
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
    const numeric = rows.some((row) => row.cells[column]?.dataset.v !== undefined);
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
      all("table.board", chapter).forEach((table) => [...table.tBodies[0].rows].forEach((row) => {
        const text = row.textContent.toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
        shown += !row.hidden;
      }));
      say(`${shown} rows shown`);
    });
  });

  // ---- choices --------------------------------------------------------------------------------
  all("select[data-options]").forEach((select) => {
    const options = all(`[data-of="${select.dataset.options}"]`);
    const show = () => {
      options.forEach((option) => { option.hidden = option.dataset.option !== select.value; });
    };
    select.addEventListener("change", show);
    if (select.value !== "0") show(); // a browser may restore what was chosen
  });

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
  showTheme();
  root.dataset.ready = "1";
})();
