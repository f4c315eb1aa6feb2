// The panel beside meshcat: sliders, time, plots, ghost, labels. MESHCAT, PACKED, COMMANDS and DATA come from the page.
const TITLES = {
  effort: "Effort", gap: "Residual: measured minus model", error: "Tracking error", parts: "Effort by cause",
};
async function unpacked(text) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const opened = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(opened).arrayBuffer());
}
async function meshcat_viewer(pane) {
  const script = document.createElement("script");
  script.textContent = new TextDecoder().decode(await unpacked(MESHCAT));
  document.head.appendChild(script);
  return new MeshCat.Viewer(pane);
}
async function draw_all(viewer) {
  const all = await unpacked(PACKED);
  for (const pieces of COMMANDS) {
    const whole = new Uint8Array(pieces.reduce((sum, [from, to]) => sum + to - from, 0));
    let at = 0;
    for (const [from, to] of pieces) { whole.set(all.subarray(from, to), at); at += to - from; }
    viewer.handle_command_bytearray(whole);
  }
}
(async function () {
  const $ = (id) => document.getElementById(id);
  const make = (tag, text, parent, cls) => {
    const e = document.createElement(tag);
    if (text) e.textContent = text;
    if (cls) e.className = cls;
    if (parent) parent.appendChild(e);
    return e;
  };
  const state = { q: DATA.q.slice(), k: 0, playing: false, factor: 100, axis: 0, hover: null, span: null };
  const frames = DATA.frames;

  // Without WebGL: a still picture, and the plots.
  const probe = document.createElement("canvas");
  const viewer = probe.getContext("webgl2") || probe.getContext("webgl") ? await meshcat_viewer($("pane")) : null;
  window.viewer = viewer;
  if (viewer) await draw_all(viewer);
  else {
    document.body.classList.add("flat");
    $("still").src = "data:image/png;base64," + DATA.still;
    $("still").hidden = $("flat").hidden = false;
  }

  // Pose of every joint: column-major 4x4, from the tree that Python wrote.
  function times(a, b) {
    const c = new Array(16).fill(0);
    for (let i = 0; i < 4; i++)
      for (let j = 0; j < 4; j++)
        for (let m = 0; m < 4; m++) c[4 * j + i] += a[4 * m + i] * b[4 * j + m];
    return c;
  }
  function moved(joint, q) {
    const [x, y, z] = joint.axis;
    if (!joint.rotary) return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x * q, y * q, z * q, 1];
    const c = Math.cos(q), s = Math.sin(q), t = 1 - c;
    return [t * x * x + c, t * x * y + s * z, t * x * z - s * y, 0,
            t * x * y - s * z, t * y * y + c, t * y * z + s * x, 0,
            t * x * z + s * y, t * y * z - s * x, t * z * z + c, 0, 0, 0, 0, 1];
  }
  const send = (command) => { if (viewer) viewer.handle_command(command); };
  const dirty = () => { if (viewer) viewer.set_dirty(); };
  function pose(body, q) {
    const world = [];
    body.joints.forEach((joint) => {
      const own = times(joint.place, moved(joint, q[joint.column]));
      const at = joint.parent < 0 ? own : times(world[joint.parent], own);
      world.push(at);
      send({ type: "set_transform", path: "/meshcat/" + joint.path, matrix: at });
    });
  }
  const property = (path, name, value) =>
    send({ type: "set_property", path: "/meshcat/" + path, property: name, value: value });

  function colour(share) {
    const low = [0.62, 0.65, 0.68], high = [0.8, 0.13, 0.1];
    return low.map((x, i) => x + Math.min(1, share) * (high[i] - x));
  }
  // Shapes of an axis in one colour, or in their own again; frames, masses and ellipsoids keep theirs.
  function paint(axis, rgb) {
    if (!viewer) return;
    const node = viewer.scene_tree.find(["meshcat"].concat(axis.path.split("/")));
    Object.entries(node.children).forEach(([name, child]) => {
      if (["frame", "mass", "inertia"].includes(name)) return;
      child.object.traverse((o) => {
        if (!o.material || !o.material.color) return;
        o.userData.own = o.userData.own || o.material.color.clone();
        if (rgb) o.material.color.setRGB(rgb[0], rgb[1], rgb[2]);
        else o.material.color.copy(o.userData.own);
      });
    });
  }
  function show() {
    let q = state.q, ghost = null;
    if (frames) {
      q = frames.q[state.k];
      if (frames.qr) ghost = q.map((x, i) => x + state.factor * (frames.qr[state.k][i] - x));
      $("time").value = state.k;
      $("now").textContent = frames.t[state.k].toFixed(3) + " s";
      if ($("tint") && $("tint").checked)
        DATA.axes.forEach((axis) => {
          const s = axis.series && axis.series.gap;
          if (s) paint(axis, colour(Math.abs(s[0].y[state.k] || 0) / axis.full));
        });
      draw();
    }
    DATA.bodies.forEach((body) => pose(body, body.ghost ? ghost || q : q));
    DATA.axes.forEach((axis, i) => {
      if (axis.slider) axis.slider.value = q[axis.column];
      if (axis.told) axis.told.textContent = (q[axis.column] * axis.scale).toFixed(axis.digits) + " " + axis.unit;
    });
    dirty();
  }

  // Sliders, postures
  const sliders = $("sliders");
  DATA.axes.forEach((axis, i) => {
    const row = make("label", "", sliders, axis.name.length > 5 ? "row long" : "row");
    make("b", axis.name, row);
    axis.slider = make("input", "", row);
    axis.slider.type = "range";
    axis.slider.min = axis.low;
    axis.slider.max = axis.high;
    axis.slider.step = (axis.high - axis.low) / 1000;
    axis.told = make("span", "", row);
    row.title = (axis.low * axis.scale).toFixed(axis.digits) + " to " + (axis.high * axis.scale).toFixed(axis.digits) +
      " " + axis.unit + (axis.limited ? " (limits of the URDF)" : " (no limits in the URDF)");
    axis.slider.oninput = () => {
      if (frames) { play(false); state.free = true; }
      if (frames && !state.loose) { state.loose = frames.q[state.k].slice(); }
      const q = frames ? state.loose : state.q;
      q[axis.column] = Number(axis.slider.value);
      DATA.bodies.forEach((body) => pose(body, q));
      axis.told.textContent = (q[axis.column] * axis.scale).toFixed(axis.digits) + " " + axis.unit;
      dirty();
    };
  });
  Object.entries(DATA.postures).forEach(([name, q]) => {
    const button = make("button", name, $("postures"));
    button.onclick = () => {
      play(false);
      DATA.bodies.forEach((body) => pose(body, q));
      state.q = q.slice();
      if (!frames) show();
      dirty();
    };
  });

  // What is drawn
  DATA.layers.forEach((layer) => {
    const row = make("label", "", $("layers"), "layer");
    const box = make("input", "", row);
    box.type = "checkbox";
    box.checked = layer.on;
    const patch = make("i", "", row);
    patch.style.background = layer.colour;
    make("span", layer.text, row);
    const set = () => {
      if (layer.labels) $("labels").hidden = !box.checked;
      layer.paths.forEach((path) => property(path, "visible", box.checked));
      dirty();
    };
    if (layer.tint) {
      box.id = "tint";
      box.onchange = () => {
        if (!box.checked) DATA.axes.forEach((axis) => paint(axis, null));
        show();
      };
    } else { box.onchange = set; set(); }
  });
  if (frames && frames.qr) {
    $("ghosted").hidden = false;
    $("factor").value = Math.log10(state.factor);
    const told = () => ($("times").textContent = state.factor + "×");
    $("factor").oninput = () => {
      state.factor = Math.round(Math.pow(10, Number($("factor").value)));
      told();
      show();
    };
    told();
  }

  // Labels over the picture: project each joint's origin.
  const tags = DATA.axes.map((axis) => make("span", axis.name, $("labels")));
  function label() {
    requestAnimationFrame(label);
    if ($("labels").hidden) return;
    const c = viewer.camera, w = $("pane").clientWidth, h = $("pane").clientHeight;
    const m = times(c.projectionMatrix.elements, c.matrixWorldInverse.elements);
    const placed = [];
    DATA.axes.forEach((axis, i) => {
      const p = viewer.scene_tree.find(["meshcat"].concat(axis.path.split("/"))).object.matrixWorld.elements;
      const v = [0, 1, 2, 3].map((r) => m[r] * p[12] + m[4 + r] * p[13] + m[8 + r] * p[14] + m[12 + r]);
      const x = (0.5 + v[0] / v[3] / 2) * w;
      let y = (0.5 - v[1] / v[3] / 2) * h;
      const wide = tags[i].offsetWidth, near = (o) => Math.abs(o.x - x) < (o.wide + wide) / 2 && Math.abs(o.y - y) < 20;
      for (let o = placed.find(near); o; o = placed.find(near)) y = o.y + 20.5;  // one name does not hide another
      placed.push({x, y, wide});
      tags[i].style.left = x + "px";
      tags[i].style.top = y + "px";
    });
  }
  if (viewer) label();

  // Time and plots
  function play(on) {
    state.playing = on;
    if ($("play")) $("play").textContent = on ? "pause" : "play";
    if (on) { state.loose = null; state.start = performance.now() - 1000 * (frames.t[state.k] - frames.t[0]) / state.speed; tick(); }
  }
  function tick() {
    if (!state.playing) return;
    const t = frames.t[0] + state.speed * (performance.now() - state.start) / 1000;
    if (t > frames.t[frames.t.length - 1]) { state.k = 0; state.start = performance.now(); }
    while (state.k + 1 < frames.t.length && frames.t[state.k + 1] <= t) state.k++;
    show();
    requestAnimationFrame(tick);
  }
  function go(k) { play(false); state.loose = null; state.k = Math.max(0, Math.min(frames.t.length - 1, k)); show(); }

  function plot(canvas, title, unit, lines) {
    const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (canvas.width !== w * ratio) { canvas.width = w * ratio; canvas.height = h * ratio; }
    const g = canvas.getContext("2d"), css = getComputedStyle(document.body);
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, w, h);
    const ink = css.color, left = 52, right = 8, top = 18, bottom = 16;
    const t = frames.t, end = t[t.length - 1], [from, to] = state.span || [t[0], end];
    let low = Infinity, high = -Infinity;
    lines.forEach((l) => l.y.forEach((y, k) => {
      if (y !== null && t[k] >= from && t[k] <= to) { low = Math.min(low, y); high = Math.max(high, y); }
    }));
    if (!(high > low)) { low -= 1; high += 1; }
    const X = (x) => left + (x - from) / (to - from) * (w - left - right);
    const Y = (y) => top + (high - y) / (high - low) * (h - top - bottom);
    g.font = "11px system-ui, sans-serif";
    g.fillStyle = ink;
    g.fillText(title + " [" + unit + "]", 4, 11);
    g.globalAlpha = 0.7;
    g.textAlign = "right";
    g.fillText(high.toPrecision(3), left - 4, top + 8);
    g.fillText(low.toPrecision(3), left - 4, h - bottom);
    g.textAlign = "left";
    g.fillText(from.toFixed(1), left, h - 3);
    g.textAlign = "right";
    g.fillText(to.toFixed(1) + " s", w - right, h - 3);
    g.textAlign = "left";
    g.globalAlpha = 0.25;
    g.strokeStyle = ink;
    g.strokeRect(left, top, w - left - right, h - top - bottom);
    if (low < 0 && high > 0) { g.beginPath(); g.moveTo(left, Y(0)); g.lineTo(w - right, Y(0)); g.stroke(); }
    g.globalAlpha = 1;
    let at = 4 + g.measureText(title + " [" + unit + "]").width + 14;
    const here = state.hover === null ? state.k : state.hover;
    g.save();
    g.beginPath();
    g.rect(left, 0, w - left - right, h);
    g.clip();
    lines.forEach((l) => {
      g.strokeStyle = l.colour;
      g.lineWidth = 1.2;
      g.beginPath();
      let pen = false;
      l.y.forEach((y, k) => {
        if (y === null) { pen = false; return; }
        if (pen) g.lineTo(X(t[k]), Y(y)); else g.moveTo(X(t[k]), Y(y));
        pen = true;
      });
      g.stroke();
      g.fillStyle = l.colour;
      const said = l.name + (l.y[here] === null ? "" : " " + l.y[here].toPrecision(3)), wide = g.measureText(said).width;
      if (at + wide < w - 4) { g.fillText(said, at, 11); at += wide + 12; }
    });
    g.strokeStyle = ink;
    for (const k of new Set([state.k, here])) {
      g.beginPath();
      g.moveTo(X(t[k]), top);
      g.lineTo(X(t[k]), h - bottom);
      g.stroke();
      g.globalAlpha = 0.4;
    }
    g.restore();
    const time = (e) => from + (e.offsetX - left) / (w - left - right) * (to - from);
    const row = (x) => { let k = 0; while (k + 1 < t.length && t[k + 1] <= x) k++; return k; };
    canvas.onpointerdown = canvas.onpointermove = (e) => {
      state.hover = e.buttons ? null : row(time(e));
      if (e.buttons) go(row(time(e))); else draw();
    };
    canvas.onpointerleave = () => { state.hover = null; draw(); };
    canvas.onwheel = (e) => {
      e.preventDefault();
      const x = time(e), by = e.deltaY > 0 ? 1.25 : 0.8;
      state.span = [Math.max(t[0], x - by * (x - from)), Math.min(end, x + by * (to - x))];
      draw();
    };
    canvas.ondblclick = () => { state.span = null; draw(); };
    canvas.title = "wheel: zoom; double click: whole log; drag: play from here";
  }
  function draw() {
    const axis = DATA.axes[state.axis];
    if (!axis.series) return;
    Object.entries(axis.series).forEach(([kind, lines]) => {
      const canvas = $("plot-" + kind);
      if (canvas) plot(canvas, TITLES[kind], kind === "error" ? axis.error_unit : axis.effort_unit, lines);
    });
  }
  if (frames) {
    document.body.classList.add("timed");
    state.speed = DATA.speed || 1;
    $("time").max = frames.t.length - 1;
    $("time").oninput = () => go(Number($("time").value));
    $("play").onclick = () => play(!state.playing);
    DATA.axes.forEach((axis, i) => {
      if (!axis.series) return;
      const option = make("option", "axis " + axis.name, $("axis"));
      option.value = i;
    });
    $("axis").onchange = () => { state.axis = Number($("axis").value); rebuild(); show(); };
    $("axis").hidden = !$("axis").options.length;
    // first the axis of which a cause was found: its residual has a second line, with the cause
    const lit = DATA.axes.findIndex((axis) => axis.series && (axis.series.gap || []).length > 1);
    if (lit >= 0) $("axis").value = lit;
    if ($("axis").options.length) state.axis = Number($("axis").value);
    rebuild();
    window.addEventListener("resize", show);
  }
  function rebuild() {
    const plots = $("plots");
    plots.textContent = "";
    Object.keys(DATA.axes[state.axis].series || {}).forEach((kind) => { make("canvas", "", plots).id = "plot-" + kind; });
  }
  document.addEventListener("keydown", (e) => {
    if (!frames || e.target.tagName === "INPUT") return;
    if (e.key === " ") { play(!state.playing); e.preventDefault(); }
    if (e.key === "ArrowRight") go(state.k + 1);
    if (e.key === "ArrowLeft") go(state.k - 1);
  });
  // The camera so near that the whole machine just fits, whatever the shape of the window, until it is moved.
  function aim() {
    const stage = DATA.stage, dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const unit = (a) => a.map((x) => x / Math.hypot(...a));
    const back = unit(stage.from), right = unit([-back[1], back[0], 0]);
    const up = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2],
                back[0] * right[1] - back[1] * right[0]];
    const tall = Math.tan(stage.fov * Math.PI / 360), wide = tall * $("pane").clientWidth / $("pane").clientHeight;
    let target = [0, 1, 2].map((k) => {
      const all = stage.points.map((p) => p[k]);
      return (Math.min(...all) + Math.max(...all)) / 2;
    });
    let distance = 1;
    for (let turn = 0; turn < 4; turn++) {  // moving the target changes the perspective a little
      const seen = stage.points.map((p) => {
        const d = p.map((x, k) => x - target[k]);
        return [dot(d, right), dot(d, up), dot(d, back)];
      });
      distance = stage.margin * Math.max(
        ...seen.map(([x, y, z]) => Math.max(Math.abs(x) / wide, Math.abs(y) / tall) + z));
      [right, up].forEach((direction, k) => {
        const at = seen.map((p) => p[k] / (distance - p[2]));
        const move = distance * (Math.min(...at) + Math.max(...at)) / 2;
        target = target.map((x, j) => x + move * direction[j]);
      });
    }
    const [x, y, z] = back.map((b) => b * distance);
    const place = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, ...target.map((x) => -x), 1];  // meshcat's camera looks at 0
    send({ type: "set_transform", path: "/meshcat", matrix: place });
    send({ type: "set_property", path: "/Cameras/default/rotated/<object>", property: "position", value: [x, z, -y] });
  }
  const fit = () => {
    if (!viewer) return;
    viewer.set_3d_pane_size($("pane").clientWidth, $("pane").clientHeight);
    if (!state.moved) aim();
    dirty();
  };
  ["pointerdown", "wheel"].forEach((kind) =>
    $("pane").addEventListener(kind, () => (state.moved = true), { capture: true, passive: true }));
  new ResizeObserver(fit).observe($("pane"));
  fit();
  show();
  // What is drawn of the machine, for whoever asks the page: triangles, and the colours they have.
  if (viewer) {
    let count = 0;
    const colours = {};
    DATA.bodies[0].joints.concat({ path: DATA.bodies[0].root + "/universe" }).forEach((joint) => {
      const node = viewer.scene_tree.find(["meshcat"].concat(joint.path.split("/")));
      Object.entries(node.children).forEach(([name, child]) => {
        if (["frame", "mass", "inertia"].includes(name)) return;
        child.object.traverse((o) => {
          if (!o.isMesh) return;
          const own = (o.geometry.index || o.geometry.attributes.position).count / 3, at = o.material.color.getHexString();
          count += own;
          colours[at] = (colours[at] || 0) + own;
        });
      });
    });
    document.body.dataset.triangles = count;
    document.body.dataset.colours = JSON.stringify(colours);
  }
})();
