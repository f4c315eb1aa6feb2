const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

/* A colour written as var(--name) in a figure follows the theme. */
function themed(value) {
  if (Array.isArray(value)) return value.map(themed);
  if (ArrayBuffer.isView(value)) return value;
  if (value && typeof value === "object") {
    const out = {};
    for (const key in value) out[key] = themed(value[key]);
    return out;
  }
  if (typeof value === "string" && value.startsWith("var(")) return css(value.slice(4, -1));
  return value;
}

let figures = [];

/* Before the text of the figures stand their arrays, all first bytes of one, then all second bytes, and so on. */
function unpacked(element) {
  const bytes = content(element), from = Number(element.dataset.text);
  const whole = (_, value) => {
    if (!value || typeof value.bdata !== "string" || value.bdata[0] !== "@") return value;
    const [at, size] = value.bdata.slice(1).split(" ").map(Number);
    const out = new Uint8Array(size), count = size / 4;
    for (let k = 0; k < size; k++) out[4 * (k % count) + Math.floor(k / count)] = bytes[at + k];
    return new (value.dtype === "f8" ? Float64Array : Float32Array)(out.buffer);
  };
  return JSON.parse(new TextDecoder().decode(bytes.subarray(from)), whole);
}

function draw(box) {
  const figure = figures[box.dataset.figure];
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
/* Paper is white and has a width of its own (A4 within its margins, at the zoom of the style sheet): all plots are
   drawn for it, none higher than a page, and for the window again afterwards. */
let worn;
window.addEventListener("beforeprint", () => {
  worn = document.documentElement.dataset.theme;
  document.documentElement.dataset.theme = "light";
  document.body.classList.add("paper");
  everyPlot(box => {
    draw(box);
    const tall = box.layout.height, height = Math.min((tall > 900 ? 0.56 : 0.68) * tall, 1450);
    box.dataset.held = box.style.cssText;
    box.style.minHeight = box.style.height = height + "px";
    window.Plotly.relayout(box, {width: box.clientWidth, height});
  });
});
window.addEventListener("afterprint", () => {
  if (worn) document.documentElement.dataset.theme = worn;
  else delete document.documentElement.dataset.theme;
  document.body.classList.remove("paper");
  everyPlot(box => {
    box.style.cssText = box.dataset.held;
    draw(box);
  });
});

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

/* Inflate (RFC 1951), at once: the browser's own unpacker answers later, after a page has been
   printed or photographed. Canonical codes are walked bit by bit; 5 MB take about 0.2 s. */
function inflate(bytes, size) {
  const out = new Uint8Array(size);
  let at = 0, place = 0, hold = 0, held = 0;
  const bits = count => {
    while (held < count) {hold |= bytes[at++] << held; held += 8}
    const value = hold & ((1 << count) - 1);
    hold >>>= count; held -= count;
    return value;
  };
  const code = lengths => {
    const count = new Uint16Array(16), start = new Uint16Array(16);
    const symbol = new Uint16Array(lengths.length);
    for (const n of lengths) count[n]++;
    count[0] = 0;
    for (let n = 1; n < 16; n++) start[n] = start[n - 1] + count[n - 1];
    lengths.forEach((n, k) => {if (n) symbol[start[n]++] = k});
    return {count, symbol};
  };
  const next = ({count, symbol}) => {
    let value = 0, first = 0, index = 0;
    for (let n = 1; ; n++) {
      if (!held) {hold = bytes[at++]; held = 8}
      value |= hold & 1; hold >>>= 1; held--;
      const here = count[n];
      if (value - here < first) return symbol[index + value - first];
      index += here; first = (first + here) << 1; value <<= 1;
    }
  };
  const base = [3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17, 19, 23, 27, 31, 35, 43, 51, 59, 67, 83, 99,
    115, 131, 163, 195, 227, 258];
  const extra = base.map((_, k) => k < 8 || k === 28 ? 0 : (k - 4) >> 2);
  const far = [1];
  for (let k = 1; k < 30; k++) far.push(far[k - 1] + (1 << Math.max(0, (k - 3) >> 1)));
  const order = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
  for (let last = 0; !last;) {
    last = bits(1);
    const kind = bits(2);
    if (kind === 0) {
      hold = held = 0;
      const n = bytes[at] | bytes[at + 1] << 8;
      out.set(bytes.subarray(at + 4, at + 4 + n), place);
      at += 4 + n; place += n;
      continue;
    }
    const all = [];
    let literals = 288;
    if (kind === 1) {
      for (let k = 0; k < 288; k++) all.push(k < 144 ? 8 : k < 256 ? 9 : k < 280 ? 7 : 8);
      for (let k = 0; k < 30; k++) all.push(5);
    } else {
      literals = bits(5) + 257;
      const total = literals + bits(5) + 1, short = new Array(19).fill(0);
      for (let k = 0, n = bits(4) + 4; k < n; k++) short[order[k]] = bits(3);
      const lengths = code(short);
      while (all.length < total) {
        const s = next(lengths);
        if (s < 16) {all.push(s); continue}
        const again = s === 16 ? all[all.length - 1] : 0;
        for (let n = s === 16 ? 3 + bits(2) : s === 17 ? 3 + bits(3) : 11 + bits(7); n; n--) {
          all.push(again);
        }
      }
    }
    const literal = code(all.slice(0, literals)), distance = code(all.slice(literals));
    for (let s = next(literal); s !== 256; s = next(literal)) {
      if (s < 256) {out[place++] = s; continue}
      let n = base[s - 257] + bits(extra[s - 257]);
      const d = next(distance), back = far[d] + bits(Math.max(0, (d >> 1) - 1));
      for (; n; n--, place++) out[place] = out[place - back];
    }
  }
  return out;
}

/* What an element of the page holds packed. */
function content(element) {
  const bytes = Uint8Array.from(atob(element.textContent.trim()), x => x.charCodeAt(0));
  return inflate(bytes, Number(element.dataset.size));
}

function start() {
  const packed = document.getElementById("plotly-packed");
  if (!packed) return;
  figures = unpacked(document.getElementById("figures-packed"));
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(content(packed));
  document.head.appendChild(script);
  everyPlot(box => {
    if (box.offsetParent && box.getBoundingClientRect().top < innerHeight) draw(box);
    else waiting.observe(box);
  });
}
start();
