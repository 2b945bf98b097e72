// What lies over the canvas: names, axes, a scale, and the list of parts to hide and isolate.

const CLOSE = [70, 24]; // pixels across and down, within which two names would cover each other
const LONGEST_SCALE = 130; // pixels
const ARM = 24; // pixels, of the axes

/** Where a point of the world is seen: shares of the canvas from its upper left; null behind the eye. */
function seenAt(point, seen, column, columns) {
  const m = seen.matrix;
  const clip = [0, 1, 3].map((r) => m[r] * point[0] + m[4 + r] * point[1] + m[8 + r] * point[2] + m[12 + r]);
  return clip[2] > 0 ? [(column + 0.5 + (0.5 * clip[0]) / clip[2]) / columns, 0.5 - (0.5 * clip[1]) / clip[2]] : null;
}

const moved = (m, [x, y, z]) => [0, 1, 2].map((r) => m[r] * x + m[4 + r] * y + m[8 + r] * z + m[12 + r]);

function label(words, kind, [x, y]) {
  const made = document.createElement("span");
  made.textContent = words;
  made.className = kind;
  made.style.left = `${100 * x}%`;
  made.style.top = `${100 * y}%`;
  return made;
}

/** Labels at `named` = [{words, kind, point}], the first ones where two would cover each other. */
function nameLabels(named, seen, column, columns, canvas) {
  const placed = [];
  return named.flatMap(({ words, kind, point }) => {
    const at = seenAt(point, seen, column, columns);
    if (!at || at[0] < column / columns || at[0] > (column + 1) / columns || at[1] < 0 || at[1] > 1) return [];
    const [x, y] = [at[0] * canvas.clientWidth, at[1] * canvas.clientHeight];
    if (placed.some(([a, b]) => Math.abs(a - x) < CLOSE[0] && Math.abs(b - y) < CLOSE[1])) return [];
    placed.push([x, y]);
    return [label(words, kind, at)];
  });
}

function drawAxes(seen) {
  const axes = document.getElementById("axes");
  if (!axes) return;
  ["x", "y", "z"].forEach((name, k) => {
    const [x, y] = [seen.right[k], -seen.up[k]];
    const line = axes.querySelector(`.${name}`), words = axes.querySelector(`.${name}-name`);
    line.setAttribute("x2", ARM * x);
    line.setAttribute("y2", ARM * y);
    words.setAttribute("x", (ARM + 8) * x);
    words.setAttribute("y", (ARM + 8) * y + 4);
  });
}

/** The longest of 1, 2, 5 times a power of ten that fits, at the depth of what the camera turns about. */
function drawScale(camera, canvas) {
  const bar = document.getElementById("scale");
  if (!bar) return;
  const metre = canvas.clientHeight / (2 * TANGENT * camera.distance);
  const longest = LONGEST_SCALE / metre, power = 10 ** Math.floor(Math.log10(longest));
  const length = [5, 2, 1].map((k) => k * power).find((size) => size <= longest);
  bar.style.width = `${length * metre}px`;
  bar.textContent = length < 1 ? `${Number((1000 * length).toPrecision(1))} mm` : `${length} m`;
}

/** Wire the list of parts: `change(hidden)` is told the numbers of those that are not to be seen. */
function partsList(change) {
  const boxes = [...document.querySelectorAll("#parts input")];
  const tell = () => change(new Set(boxes.filter((box) => !box.checked).map((box) => Number(box.dataset.part))));
  boxes.forEach((box) => box.addEventListener("change", tell));
  document.querySelectorAll("#parts [data-only]").forEach((button) => button.addEventListener("click", () => {
    boxes.forEach((box) => (box.checked = button.dataset.only === "all" || box.dataset.part === button.dataset.only));
    tell();
  }));
}
