// What the page does: the slider moves the scene, the cursors of the curves and the values in the tables.

const data = JSON.parse(document.getElementById("data").textContent);
const one = (selector) => document.querySelector(selector);
const all = (selector) => [...document.querySelectorAll(selector)];
const NARROW = 600; // pixels
const MOST_TOLD = 3; // bodies whose places are told
const state = { moment: data.begin, playing: false, last: 0, stage: null };

function theme(printing = false) {
  const style = getComputedStyle(document.documentElement);
  const names = ["paper", "still", "moving", "hit", "edge", "ink", "broken"];
  const suffix = printing ? "-printed" : "";
  return Object.fromEntries(names.map((name) => [name, rgb(style.getPropertyValue(`--scene-${name}${suffix}`).trim())]));
}

const chosen = (name) => one(`input[name=${name}]:checked`)?.value;
const ticked = (name) => Boolean(one(`input[name=${name}]`)?.checked);

/** The solved frame nearest to the moment, of the motion that curves and tables are about. */
function solvedFrame() {
  let best = 0;
  data.motion.forEach((at, k) => {
    if (Math.abs(at - state.moment) < Math.abs(data.motion[best] - state.moment)) best = k;
  });
  return best;
}

/** Where a body is at a share of the motion: evenly on its way, or straight between its own places. */
function place({ start, stop, shares, values }, share) {
  const after = shares ? shares.findIndex((at) => at >= share) : -1;
  if (after < 0) return start + share * (stop - start);
  if (after === 0) return values[0];
  const part = (share - shares[after - 1]) / (shares[after] - shares[after - 1]);
  return values[after - 1] + part * (values[after] - values[after - 1]);
}

/** A moment, 0 to 1, in the unit of each body that moves, and per cent. */
function told(moment) {
  const { ways, out_and_back: back } = data.path, share = back ? 1 - Math.abs(2 * moment - 1) : moment;
  const places = ways.slice(0, MOST_TOLD).map((way) => {
    const { body, unit } = way, value = place(way, share).toFixed(unit === "s" ? 2 : 1);
    return `${ways.length > 1 ? `${body} ` : ""}${value === "-0.0" ? "0.0" : value} ${unit}`;
  });
  const way = back && moment > 0.5 ? " on the way back" : "";
  const percent = `${(100 * moment).toFixed(1)} %`;
  return places.length ? `${places.join(", ")}${way}, ${percent}` : percent;
}

const number = (value, digits) => (value === null || value === undefined ? "-" : value.toFixed(digits));

function tell() {
  const frame = solvedFrame();
  one("#slider").value = state.moment;
  one("#moment").textContent =
    `${told(data.motion[frame])}, ${(data.motion[frame] * data.path.duration).toFixed(2)} s, ` +
    `frame ${frame} of ${data.motion.length - 1}`;
  all("[data-row]").forEach((cell) => {
    const row = data.rows[cell.dataset.row], value = row.values[frame];
    cell.textContent = value !== null && value > 1e5 ? "straight" : number(value, row.digits);
    cell.classList.toggle("broken", value !== null && (row.most ? value > row.limit : value < row.limit));
  });
  all("[data-curve]").forEach((cell) => {
    const value = data.curves[cell.dataset.curve][frame];
    cell.textContent = value === null ? "-" : value > 1e5 ? "far" : Number(value.toPrecision(3)).toString();
  });
  const x = data.chart.left + data.motion[frame] * (data.chart.width - data.chart.left - data.chart.right);
  all(".cursor").forEach((line) => {
    line.setAttribute("x1", x);
    line.setAttribute("x2", x);
  });
}

function shownActs() {
  const wanted = chosen("shown");
  if (data.scenes.length === 1) return [0];
  return wanted === "before" ? [0] : wanted === "after" ? [1] : [0, 1];
}

function drawKey(mode) {
  if (!one("#key")) return;
  one("#key").dataset.mode = mode;
  const scale = data.scales[mode];
  one("#ramp").hidden = !scale;
  one("#states").hidden = Boolean(scale);
  if (!scale) return;
  one("#bar").style.background = `linear-gradient(90deg, ${data.ramp.map(([at, hex]) => `${hex} ${100 * at}%`).join(", ")})`;
  one("#quantity").textContent = scale.title;
  one("#ticks").replaceChildren(...scale.ticks.map(([at, words, limit]) => {
    const tick = document.createElement("span");
    tick.textContent = words;
    tick.className = limit ? "limit" : "";
    tick.style.left = `${100 * at}%`;
    return tick;
  }));
}

function draw(printing = false) {
  const { stage } = state;
  tell();
  if (!stage) return;
  const canvas = one("#canvas"), ratio = Math.min(window.devicePixelRatio || 1, 2), shown = shownActs();
  const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const options = {
    mode: chosen("mode"), parts: chosen("parts"), ghosts: ticked("ghosts"), frames: ticked("frames"),
    witness: ticked("witness"), names: ticked("names"),
  };
  drawKey(options.mode);
  const drawn = stage.draw(state.moment, shown, options, theme(printing));
  one("#labels").replaceChildren(...drawn.flatMap(({ sceneView, seen, witness }, column) => {
    const labels = options.names ? nameLabels(stage.names(sceneView, options), seen, column, shown.length, canvas) : [];
    if (sceneView.scene.title) labels.push(label(sceneView.scene.title, "title", [column / shown.length, 0]));
    const side = witness && witness.at[0] * shown.length - column > 0.7 ? " left" : "";
    if (witness) labels.push(label(witness.words, `witness${side}${witness.broken ? " broken" : ""}`, witness.at));
    return labels;
  }));
  drawAxes(drawn[0].seen);
  drawScale(stage.camera, canvas);
}

let asked = false;
function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    draw();
  });
}

function go(moment) {
  state.moment = Math.max(0, Math.min(1, moment));
  one("#slider").value = state.moment;
  redraw();
}

function step(by) {
  const sceneView = state.stage?.sceneViews.at(-1), at = sceneView ? sceneView.scene.motion : data.motion;
  const frame = sceneView ? sceneView.nearestFrame(state.moment) : solvedFrame();
  go(at[Math.max(0, Math.min(at.length - 1, frame + by))]);
}

function play(wanted) {
  state.playing = wanted;
  one("#play").textContent = wanted ? "Pause" : "Play";
  one("#play").setAttribute("aria-pressed", wanted);
  if (!wanted) return;
  if (state.moment >= 1) go(0);
  state.last = performance.now();
  const tick = (now) => {
    if (!state.playing) return;
    go(state.moment + (now - state.last) / 1000 / data.path.duration);
    state.last = now;
    if (state.moment >= 1) play(false);
    else requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

function handlePointer(canvas) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) return;
    const apart = pointers.size === 2 ? spread() : 0, { camera } = state.stage;
    const x = event.clientX - before.x, y = event.clientY - before.y;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (pointers.size === 2) camera.nearer(spread() / Math.max(apart, 1));
    else if (event.shiftKey || event.buttons & 6) camera.shift(x / canvas.clientHeight, y / canvas.clientHeight);
    else camera.turn(0.008 * x, 0.008 * y);
    redraw();
  });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  // only where somebody is at work in the scene: else the page is scrolled
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    state.stage.camera.nearer(Math.exp(-0.0015 * event.deltaY));
    redraw();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const keys = { ArrowLeft: () => step(-1), ArrowRight: () => step(1), " ": () => play(!state.playing), w: () => go(data.worst),
      "+": () => state.stage.camera.nearer(1.2), "-": () => state.stage.camera.nearer(1 / 1.2) };
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]();
    redraw();
  });
}

function begin() {
  const after = one("input[name=shown][value=after]");
  if (after && innerWidth < NARROW) after.checked = true; // two side by side would be stamps
  one("#slider").addEventListener("input", (event) => {
    play(false);
    go(Number(event.target.value));
  });
  one("#play").addEventListener("click", () => play(!state.playing));
  one("#worst")?.addEventListener("click", () => go(data.worst));
  all("#controls input").forEach((input) => input.addEventListener("change", redraw));
  all("[data-look]").forEach((button) => button.addEventListener("click", () => {
    if (!state.stage) return;
    const sides = { top: [0, 0, 1], front: [0, -1, 0], side: [1, 0, 0] };
    state.stage.camera.face(sides[button.dataset.look] ?? data.view.back, button.dataset.look === "near");
    redraw();
  }));
  all("[data-go]").forEach((button) => button.addEventListener("click", () => {
    go(Number(button.dataset.go));
    one("#scene").scrollIntoView({ behavior: "smooth", block: "nearest" });
  }));
  all("svg.chart").forEach((chart) => chart.addEventListener("click", (event) => {
    const box = chart.getBoundingClientRect(), x = ((event.clientX - box.left) / box.width) * data.chart.width;
    go((x - data.chart.left) / (data.chart.width - data.chart.left - data.chart.right));
  }));
  if (data.scenes.length) {
    try {
      state.stage = new Stage(one("#canvas"), data);
      handlePointer(one("#canvas"));
      partsList((hidden) => {
        state.stage.hidden = hidden;
        redraw();
      });
    } catch (error) {
      one("#no-scene").hidden = false;
      one("#no-scene").textContent = `The scene can't be drawn: ${error.message}. Everything else in this report stands.`;
    }
  }
  new ResizeObserver(redraw).observe(one("#canvas") ?? document.body);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  all("[data-fold]").forEach((button) => {
    const group = button.closest("tbody");
    group.classList.add("folded");
    button.addEventListener("click", () => {
      const open = !group.classList.toggle("folded");
      button.textContent = open ? "less" : button.dataset.fold;
      button.setAttribute("aria-expanded", open);
    });
  });
  const closed = all("details:not([open])");
  addEventListener("beforeprint", () => {
    closed.forEach((details) => (details.open = !details.dataset.screen));
    draw(true);
  });
  addEventListener("afterprint", () => {
    closed.forEach((details) => (details.open = false));
    draw();
  });
  draw();
}

if (data.motion.length) begin();
