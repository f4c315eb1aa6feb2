"""The page's own script: unpacks plotly, draws a plot when it comes into view, sorts, switches."""

SCRIPT = """
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/* A colour written as var(--name) in a figure follows the theme. */
function themed(value) {
  if (Array.isArray(value)) return value.map(themed);
  if (value && typeof value === "object") {
    const out = {};
    for (const key in value) out[key] = themed(value[key]);
    return out;
  }
  if (typeof value === "string" && value.startsWith("var(")) return css(value.slice(4, -1));
  return value;
}

function draw(box) {
  const figure = JSON.parse(document.getElementById(box.dataset.figure).textContent);
  const layout = themed(figure.layout);
  for (const key in layout) if (/^[xy]axis/.test(key)) {
    Object.assign(layout[key], {gridcolor: css("--grid"), zerolinecolor: css("--line"),
      linecolor: css("--line")});
  }
  layout.font = Object.assign({}, layout.font, {color: css("--soft")});
  layout.modebar = {bgcolor: "rgba(0,0,0,0)", color: css("--soft"), activecolor: css("--accent")};
  layout.hoverlabel = {bgcolor: css("--card"), bordercolor: css("--line"),
    font: {color: css("--ink")}};
  const config = {responsive: true, displaylogo: false,
    modeBarButtonsToRemove: ["lasso2d", "select2d", "autoScale2d"]};
  window.Plotly.react(box, themed(figure.data), layout, config);
  box.dataset.drawn = "1";
}

const waiting = new IntersectionObserver(seen => {
  for (const item of seen) if (item.isIntersecting) {
    waiting.unobserve(item.target);
    draw(item.target);
  }
}, {rootMargin: "600px"});

function everyPlot(action) {document.querySelectorAll(".plot").forEach(action)}
function redraw() {everyPlot(box => {if (box.dataset.drawn) draw(box)})}

document.getElementById("theme").addEventListener("click", () => {
  const dark = document.documentElement.dataset.theme === "dark" ||
    (!document.documentElement.dataset.theme && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  redraw();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
window.addEventListener("beforeprint", () => everyPlot(box => {if (!box.dataset.drawn) draw(box)}));

document.querySelectorAll(".tabs").forEach(tabs => {
  const heads = tabs.querySelectorAll(":scope > .heads > button");
  const panels = tabs.querySelectorAll(":scope > .panel");
  heads.forEach((head, k) => head.addEventListener("click", () => {
    heads.forEach((other, i) => other.setAttribute("aria-selected", i === k));
    panels.forEach((panel, i) => {panel.hidden = i !== k});
    window.dispatchEvent(new Event("resize"));
  }));
});

document.querySelectorAll("th[data-sort]").forEach(head => head.addEventListener("click", () => {
  const table = head.closest("table");
  const column = [...head.parentNode.children].indexOf(head);
  const down = head.getAttribute("aria-sort") === "ascending";
  table.querySelectorAll("th").forEach(other => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", down ? "descending" : "ascending");
  const key = row => {
    const cell = row.children[column];
    const given = cell.dataset.key === undefined ? cell.textContent.trim() : cell.dataset.key;
    if (head.dataset.sort === "text") return given;
    return given === "" ? NaN : Number(given);
  };
  const order = (a, b) => {
    const x = key(a), y = key(b);
    if (typeof x === "string") return (down ? -1 : 1) * x.localeCompare(y, "en", {numeric: true});
    if (isNaN(x) || isNaN(y)) return isNaN(x) - isNaN(y);  // what is not known goes last
    return down ? y - x : x - y;
  };
  table.querySelectorAll("tbody").forEach(body => {
    const fixed = body.querySelectorAll("tr.group, tr.summary");
    const rows = [...body.querySelectorAll("tr:not(.group):not(.summary)")].sort(order);
    body.replaceChildren(...fixed, ...rows);
  });
}));

document.querySelectorAll("button.fold").forEach(button => button.addEventListener("click", () => {
  const folded = button.closest("tbody").classList.toggle("folded");
  button.textContent = folded ? "show all" : "hide";
}));

async function unpack() {
  const packed = document.getElementById("plotly-packed");
  if (!packed) return;
  const bytes = Uint8Array.from(atob(packed.textContent.trim()), c => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.appendChild(script);
  everyPlot(box => waiting.observe(box));
}
unpack().catch(error => everyPlot(box => {
  box.textContent = "This browser cannot draw the plots (" + error + "); the tables are complete.";
}));
"""
