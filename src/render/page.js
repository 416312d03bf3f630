"use strict";
(() => {
  const root = document.documentElement;
  let errors = 0;
  addEventListener("error", () => { root.dataset.errors = String(++errors); });
  root.dataset.errors = "0";
  const key = (row, column) => {
    const cell = row.cells[column];
    return cell.dataset.value === undefined ? cell.textContent : Number(cell.dataset.value);
  };
  // Numbers before texts, so that dashes come last.
  const compare = (a, b) => {
    if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
    return typeof a === "number" ? a - b : a.localeCompare(b, "en", { numeric: true });
  };
  document.addEventListener("click", (event) => {
    const button = event.target.closest("th button");
    if (!button) return;
    const head = button.closest("th");
    const body = head.closest("table").tBodies[0];
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const column = Number(button.dataset.column);
    const rows = [...body.rows].map((row) => [key(row, column), row]);
    rows.sort((a, b) => (up || typeof a[0] !== typeof b[0] ? 1 : -1) * compare(a[0], b[0]));
    body.append(...rows.map((pair) => pair[1]));
  });
  addEventListener("load", () => {
    const drawn = [...document.querySelectorAll("svg.figure")].filter((svg) => {
      const box = svg.getBoundingClientRect();
      return Math.min(box.width, box.height) > 0;
    });
    root.dataset.figures = String(drawn.length);
    root.dataset.overflow = String(Math.max(0, root.scrollWidth - root.clientWidth));
    root.dataset.width = String(innerWidth);
    root.dataset.scheme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
    root.dataset.ready = "true";
  });
})();
