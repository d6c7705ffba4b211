// The choice of a theme, and cells of the confusion matrix that show the records behind them.
"use strict";
(() => {
  document.getElementById("theme").addEventListener("change", ({ target }) => {
    if (target.value) document.documentElement.dataset.theme = target.value;
    else delete document.documentElement.dataset.theme;
    document.dispatchEvent(new Event("theme-change"));
  });
  const cells = [...document.querySelectorAll("button[data-cell]")];
  for (const cell of cells) {
    cell.addEventListener("click", () => {
      const open = cell.getAttribute("aria-expanded") !== "true";
      for (const other of cells) {
        const shown = open && other === cell;
        other.setAttribute("aria-expanded", String(shown));
        document.getElementById(other.dataset.cell).hidden = !shown;
      }
    });
  }
  for (const button of document.querySelectorAll("button[data-record]")) {
    button.addEventListener("click", () => {
      document.dispatchEvent(new CustomEvent("replay-show", { detail: button.dataset.record }));
    });
  }
})();
