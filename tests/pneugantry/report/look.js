// What a reader meets: contrast, the choice of a log, the keyboard; told on the console.
addEventListener("load", function () {
  const root = getComputedStyle(document.documentElement);
  const light = function (name) {
    const hex = root.getPropertyValue(name).trim().slice(1), n = hex.length === 3 ? 1 : 2;
    const part = [0, 1, 2].map(function (i) { return parseInt(hex.substr(i * n, n).repeat(3 - n), 16) / 255; });
    const l = part.map(function (v) { return v <= 0.04045 ? v / 12.92 : Math.pow((v + 0.055) / 1.055, 2.4); });
    return 0.2126 * l[0] + 0.7152 * l[1] + 0.0722 * l[2];
  };
  const contrast = function (a, b) {
    const [x, y] = [light(a), light(b)].sort(function (p, q) { return q - p; });
    return (x + 0.05) / (y + 0.05);
  };
  const words = ["--ink", "--faint", "--flag", "--line"].map(function (v) { return contrast(v, "--paper"); });
  const curves = ["--blue", "--orange", "--measured"].map(function (v) { return contrast(v, "--paper"); });
  const choice = document.getElementById("log"), before = document.documentElement.dataset.window;
  choice.focus(); choice.value = choice.options[1].value; choice.dispatchEvent(new Event("change"));
  const fold = document.getElementById("seen"), heads = fold.querySelector("summary");
  heads.focus(); const reached = document.activeElement === heads && !fold.open; heads.click();
  const table = fold.querySelector("table").getBoundingClientRect();
  const canvas = document.querySelector("canvas"); canvas.focus();
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "+", bubbles: true }));
  setTimeout(function () {
    const shown = [...document.querySelectorAll(".of-log")].filter(function (e) { return !e.hidden; });
    console.log("PROBE" + JSON.stringify({ words: Math.min(...words), curves: Math.min(...curves),
      dark: light("--paper") < 0.2, wide: document.documentElement.scrollWidth > innerWidth,
      focus: document.activeElement === canvas, title: document.getElementById("signals").textContent,
      strips: shown.length, unfolded: reached && fold.open && table.height > 40, before, after: document.documentElement.dataset.window }));
  }, 300);
});
