// The choice of a theme, and cells that show the records behind them.
"use strict";
(() => {
  document.getElementById("theme").addEventListener("change", ({ target }) => {
    if (target.value) document.documentElement.dataset.theme = target.value;
    else delete document.documentElement.dataset.theme;
    document.dispatchEvent(new Event("theme-change"));
  });
})();
