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
  const sort = (table, column, head, up = head.getAttribute("aria-sort") !== "ascending") => {
    const ascending = up;
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
    const heads = [...table.tHead.rows[0].cells];
    const names = heads.map((head) => head.textContent);
    [...table.tBodies[0].rows].forEach((row) => [...row.cells].forEach((cell, column) => {
      cell.dataset.head = names[column];
      if (cell.textContent.length > 24 && !cell.matches(".n, .who")) cell.classList.add("words");
    }));
    if (table.tBodies[0].rows.length < 2) return;
    const label = document.createElement("label");
    label.className = "sortby";
    const select = document.createElement("select");
    select.append(new Option("as ranked", ""), ...names.map((name, column) => new Option(name, column)));
    label.append("Sort by ", select);
    table.before(label);
    const ranked = [...table.tBodies[0].rows];
    const restore = () => {
      table.tBodies[0].append(...ranked);
      all("th", table.tHead).forEach((head) => head.removeAttribute("aria-sort"));
      say("as ranked");
    };
    select.addEventListener("change", () => {
      if (select.value === "") restore();
      else sort(table, Number(select.value), heads[select.value], true);
    });
    heads.forEach((head, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.append(...head.childNodes);
      if (head.title) button.setAttribute("aria-label", head.title);
      head.append(button);
      button.addEventListener("click", () => {
        if (head.getAttribute("aria-sort") === "descending") restore(); // the third click
        else sort(table, column, head);
      });
    });
  });
  all("input[data-filter]").forEach((input) => {
    const chapter = byId(input.dataset.filter);
    const none = document.createElement("p");
    none.className = "note";
    none.textContent = "No row holds all of these words.";
    none.hidden = true;
    input.closest("header").after(none);
    input.addEventListener("input", () => {
      const words = input.value.toLowerCase().split(/[\s,]+/).filter(Boolean);
      let shown = 0;
      all("table.board", chapter).forEach((table) => [...table.tBodies[0].rows].forEach((row) => {
        const text = row.textContent.toLowerCase();
        row.hidden = !words.every((word) => text.includes(word));
        shown += !row.hidden;
      }));
      none.hidden = shown > 0;
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

  // ---- tables that are too wide ---------------------------------------------------------------
  const fit = (within = document) => {
    const boxes = all(".scroll", within).filter((box) => box.clientWidth);
    const wide = () => boxes.filter((box) => box.scrollWidth > box.clientWidth + 1);
    boxes.forEach((box) => box.classList.remove("tight", "cards"));
    wide().forEach((box) => box.classList.add("tight"));
    wide().forEach((box) => box.classList.replace("tight", "cards"));
  };
  all("details").forEach((fold) => fold.addEventListener("toggle", () => { if (fold.open) fit(fold); }));
  all("select[data-options]").forEach((select) => select.addEventListener("change", () => fit()));
  let width = 0;
  new ResizeObserver(() => {
    if (root.clientWidth === width) return;
    width = root.clientWidth;
    fit();
  }).observe(root);
  fit();

  // ---- links to rows --------------------------------------------------------------------------
  const reveal = () => {
    all("tr.linked").forEach((row) => row.classList.remove("linked"));
    const target = byId(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    for (let at = target; at; at = at.parentElement) if (at.tagName === "DETAILS") at.open = true;
    if (target.tagName === "TR") target.classList.add("linked");
    fit();
    target.scrollIntoView({ block: target.tagName === "TR" ? "center" : "start" });
  };
  window.addEventListener("hashchange", reveal);
  if (location.hash) reveal();

  const here = new IntersectionObserver((entries) => entries.forEach((entry) => {
    const link = document.querySelector(`nav a[href="#${entry.target.id}"]`);
    if (!link) return; // a page of a site: its links lead to other pages
    link.classList.toggle("here", entry.isIntersecting);
    if (entry.isIntersecting) link.setAttribute("aria-current", "true"); else link.removeAttribute("aria-current");
  }), { rootMargin: "-20% 0px -70% 0px" });
  all("section.chapter").forEach((chapter) => here.observe(chapter));

  document.querySelector("nav .here")?.scrollIntoView({ block: "nearest", inline: "center" });

  byId("theme").addEventListener("click", () => {
    theme = themes[(themes.indexOf(theme) + 1) % themes.length];
    remember(theme);
    showTheme();
  });
  showTheme();
  root.dataset.ready = "1";
})();
