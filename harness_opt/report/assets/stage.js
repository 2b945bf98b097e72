// The scene: parts, cables, ghosts, clamp frames and closest points of one or two motions, at a moment of them.

const SIDES = 18;

const rgb = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);

function ramp(stops, t) {
  const at = Math.max(0, Math.min(1, t)), k = Math.max(1, stops.findIndex(([stop]) => stop >= at));
  const [[from, one], [to, other]] = [stops[k - 1], stops[k]], share = (at - from) / (to - from);
  return add(scale(rgb(one), 1 - share), rgb(other), share);
}

const inSteps = ({ low, step, steps }) => Float32Array.from(decode(steps, Uint16Array), (k) => low + step * k);

/** One motion on the stage: its numbers decoded, and the buffers of its cables. */
class SceneView {
  constructor(renderer, scene, colours) {
    Object.assign(this, { renderer, scene, frame: -1, mode: null });
    this.bodies = {};
    for (const [name, text] of Object.entries(scene.bodies)) this.bodies[name] = decode(text, Float32Array);
    this.cables = scene.cables.map((cable, k) => ({
      ...cable,
      colour: rgb(colours[k % colours.length]),
      position: decode(cable.position, Float32Array),
      curvature: inSteps(cable.curvature),
      twist: inSteps(cable.twist),
      clearance: inSteps(cable.clearance),
      state: decode(cable.state, Uint8Array),
      clamps: decode(cable.clamps, Float32Array),
    }));
    this.nearest = scene.nearest.map((pair) => ({ ...pair, points: decode(pair.points, Float32Array) }));
    this.ghosts = scene.ghosts.map((frame) => ({
      frame,
      cables: this.cables.map((cable) => renderer.mesh(tube(this.line(cable, frame), cable.radius, SIDES))),
    }));
  }

  line(cable, frame) {
    return cable.position.subarray(3 * cable.stations * frame, 3 * cable.stations * (frame + 1));
  }

  /** The shown frame nearest to a moment, 0 to 1. */
  nearestFrame(moment) {
    let best = 0;
    this.scene.motion.forEach((at, k) => {
      if (Math.abs(at - moment) < Math.abs(this.scene.motion[best] - moment)) best = k;
    });
    return best;
  }

  pose(body, frame) {
    const numbers = this.bodies[body].subarray(7 * frame, 7 * frame + 7);
    return placement(numbers.subarray(0, 3), numbers.subarray(3));
  }

  /** Where the clamp number `end` of a cable stands, in the order of `cable.clamped`, its stations. */
  clamp(cable, end, frame) {
    const line = this.line(cable, frame), station = cable.clamped[end];
    const first = 4 * (cable.clamped.length * frame + end);
    return placement(line.subarray(3 * station, 3 * station + 3), cable.clamps.subarray(first, first + 4));
  }

  /** Show `frame` with cables coloured by `colour(cable, station index)`. */
  set(frame, mode, colour) {
    if (this.frame === frame && this.mode === mode) return;
    Object.assign(this, { frame, mode });
    for (const cable of this.cables) {
      const data = tube(this.line(cable, frame), cable.radius, SIDES);
      const first = cable.stations * frame;
      const shades = Array.from({ length: cable.stations }, (_, k) => colour(cable, first + k));
      data.colours = new Float32Array(data.positions.length);
      data.stations.forEach((station, k) => data.colours.set(shades[station], 3 * k));
      if (cable.mesh) this.renderer.fill(cable.mesh, data);
      else cable.mesh = this.renderer.mesh(data);
    }
  }

  /** What is tightest in this frame: {from, to, words, broken}, or null. */
  witness(mode) {
    if (mode === "bend" || mode === "twist") return this.extreme(mode);
    let best = null;
    for (const pair of this.nearest) {
      const clearance = pair.clearance[this.frame], margin = clearance - (pair.limit ?? 0);
      if (!best || margin < best.margin) best = { pair, clearance, margin };
    }
    if (!best) return this.extreme("bend");
    const { pair, clearance } = best, points = pair.points.subarray(6 * this.frame, 6 * this.frame + 6);
    const other = pair.other;
    const size = `${(1000 * Math.abs(clearance)).toFixed(1)} mm`;
    return {
      from: [...points.subarray(0, 3)],
      to: [...points.subarray(3)],
      words: clearance < 0 ? `${size} deep in ${other}` : `${size} to ${other}`,
      broken: clearance < (pair.limit ?? 0),
    };
  }

  extreme(mode) {
    let best = null;
    for (const cable of this.cables) {
      const values = mode === "bend" ? cable.curvature : cable.twist;
      for (let k = 0; k < cable.stations; k++) {
        const value = values[cable.stations * this.frame + k];
        if (!best || value > best.value) best = { cable, k, value };
      }
    }
    if (!best) return null;
    const line = this.line(best.cable, this.frame), at = [...line.subarray(3 * best.k, 3 * best.k + 3)];
    const radius = 1000 / Math.max(best.value, 1e-9);
    const words = mode === "twist" ? `twist ${best.value.toFixed(0)} deg/m`
      : radius < 1e5 ? `bend radius ${radius.toFixed(1)} mm` : "straight";
    return { from: at, to: at, words, broken: false };
  }
}

/** Everything on the canvas. */
class Stage {
  constructor(canvas, data) {
    this.renderer = new Renderer(canvas);
    this.camera = new Camera(data.view);
    this.data = data;
    this.parts = data.parts.map((part) => {
      const whole = decode(part.vertices, Uint16Array), vertices = new Float32Array(whole.length);
      whole.forEach((value, k) => (vertices[k] = part.lower[k % 3] + value * part.step[k % 3]));
      const made = solid(vertices, decode(part.faces, part.wide ? Uint32Array : Uint16Array));
      const bounds = [0, 1, 2].map((k) => {
        let [low, high] = [Infinity, -Infinity];
        for (let i = k; i < vertices.length; i += 3) [low, high] = [Math.min(low, vertices[i]), Math.max(high, vertices[i])];
        return (low + high) / 2;
      });
      return { ...part, middle: bounds, mesh: this.renderer.mesh(made), edges: this.renderer.mesh({ positions: made.edges }) };
    });
    this.sceneViews = data.scenes.map((scene) => new SceneView(this.renderer, scene, scene.colours));
    this.frameArrows = this.data.palette.axes.map((_, k) => this.renderer.mesh(arrow(k, 16)));
    this.sleeve = this.renderer.mesh(tube(new Float32Array([0, 0, -0.4, 0, 0, 2.2]), 1.5, 24));
    this.pointer = this.renderer.mesh({ positions: new Float32Array(3) });
    this.hidden = new Set(); // numbers of parts
  }

  visible(options) {
    return options.parts === "none" ? [] : this.parts.filter((_, k) => !this.hidden.has(k));
  }

  /** Draw the scene views numbered in `shown` side by side, and return where their labels go, 0 to 1 of the canvas. */
  draw(moment, shown, options, theme) {
    const canvas = this.renderer.canvas, width = Math.floor(canvas.width / shown.length);
    return shown.map((number, column) => {
      const sceneView = this.sceneViews[number];
      sceneView.set(sceneView.nearestFrame(moment), options.mode, (cable, k) => this.colour(cable, k, options.mode));
      const seen = this.renderer.begin([column * width, 0, width, canvas.height], this.camera, theme.paper);
      this.drawParts(sceneView, options, theme);
      this.drawCables(sceneView, options);
      this.drawClamps(sceneView, options, theme);
      this.drawGlass(options);
      if (options.ghosts) this.drawGhosts(sceneView, options, theme);
      return { sceneView, seen, ...this.drawWitness(sceneView, seen, options, theme, column, shown.length) };
    });
  }

  colour(cable, k, mode) {
    const { scales, ramp: stops } = this.data;
    if (mode === "bend") return ramp(stops, cable.curvature[k] / scales.bend.most);
    if (mode === "twist") return ramp(stops, cable.twist[k] / scales.twist.most);
    if (mode === "clearance") return ramp(stops, 1 - cable.clearance[k] / scales.clearance.most);
    const number = cable.state[k], state = this.data.palette.states[number];
    if (!state) return cable.colour;
    // rings as well as colours: broad ones where a limit is broken, narrow ones where something is touched
    const pale = k % (number === 1 ? 4 : 2) >= (number === 1 ? 2 : 1);
    return pale ? add(scale(rgb(state), 0.45), [1, 1, 1], 0.55) : rgb(state);
  }

  drawParts(sceneView, options, theme) {
    const touched = new Set(sceneView.nearest.filter((pair) => pair.clearance[sceneView.frame] < 0).map((pair) => pair.part));
    const clear = (part) => options.parts === "glass" || touched.has(part.name);
    for (const part of this.visible(options).sort((a, b) => clear(a) - clear(b))) {
      const model = sceneView.pose(part.body, sceneView.frame), glass = clear(part);
      const colour = touched.has(part.name) || part.odd ? theme.hit : part.moves ? theme.moving : theme.still;
      part.pending = { model, colour, glass };
      if (!glass) this.renderer.draw(part.mesh, { model, colour });
      this.renderer.drawLines(part.edges, { model, colour: theme.edge, alpha: glass ? 0.55 : 1 });
    }
  }

  drawCables(sceneView, options) {
    for (const cable of sceneView.cables) {
      this.renderer.draw(cable.mesh, { shine: 0.3 });
      for (const end of cable.clamped.keys()) {
        const model = sceneView.clamp(cable, end, sceneView.frame), last = end === cable.clamped.length - 1;
        const size = cable.radius * (last ? -1 : 1);
        const sized = (k) => multiply(model, new Float32Array([k[0], 0, 0, 0, 0, k[1], 0, 0, 0, 0, k[2], 0, 0, 0, 0, 1]));
        this.renderer.draw(this.sleeve, { model: sized([Math.abs(size), Math.abs(size), size]), colour: rgb(this.data.palette.sleeve) });
        if (!options.frames) continue;
        const long = 10 * cable.radius;
        this.data.palette.axes.forEach((hex, k) => this.renderer.draw(this.frameArrows[k], { model: sized([long, long, long]), colour: rgb(hex) }));
      }
    }
  }

  /** Clamps of a scene that was not solved: a sleeve, an arrow along the cable, d1 where the roll is given, and the
   * straight line to the other end. */
  drawClamps(sceneView, options, theme) {
    const sized = (model, k) => multiply(model, new Float32Array([k, 0, 0, 0, 0, k, 0, 0, 0, 0, k, 0, 0, 0, 0, 1]));
    for (const clamp of sceneView.scene.clamps ?? []) {
      const model = multiply(sceneView.pose(clamp.body, sceneView.frame), placement(clamp.position, clamp.quaternion));
      const colour = rgb(clamp.odd ? this.data.palette.states[2] : this.data.palette.sleeve);
      this.renderer.draw(this.sleeve, { model: sized(model, clamp.radius), colour });
      const long = clamp.long, arrows = clamp.roll ? [0, 2] : [2];
      if (clamp.tangent) arrows.forEach((k) => this.renderer.draw(this.frameArrows[k], {
        model: sized(model, long), colour: rgb(this.data.palette.axes[k]), above: true, shine: 0 }));
    }
    for (const line of sceneView.scene.lines ?? []) {
      const ends = line.ends.map(({ body, position }) => moved(sceneView.pose(body, sceneView.frame), position));
      this.renderer.fill(this.pointer, { positions: new Float32Array(ends.flat()) });
      this.renderer.drawLines(this.pointer, { colour: line.colour ? rgb(line.colour) : theme.ink, above: true });
    }
  }

  drawGlass(options) {
    for (const part of this.visible(options)) {
      if (part.pending?.glass)
        this.renderer.draw(part.mesh, { model: part.pending.model, colour: part.pending.colour, alpha: 0.32 });
    }
  }

  /** What is named, for labels: [{words, kind, point}], clamps first. */
  names(sceneView, options) {
    const clamps = (sceneView.scene.clamps ?? []).map((clamp) => ({
      words: clamp.name, kind: clamp.odd ? "name odd" : "name clamp",
      point: moved(sceneView.pose(clamp.body, sceneView.frame), clamp.position) }));
    const parts = this.visible(options).map((part) => ({ words: part.name, kind: part.odd ? "name odd" : "name",
      point: moved(sceneView.pose(part.body, sceneView.frame), part.middle) }));
    return [...clamps, ...parts.sort((a, b) => (b.kind === "name odd") - (a.kind === "name odd"))];
  }

  drawGhosts(sceneView, options, theme) {
    for (const ghost of sceneView.ghosts) {
      if (ghost.frame === sceneView.frame) continue;
      sceneView.cables.forEach((cable, k) => this.renderer.draw(ghost.cables[k], { colour: cable.colour, alpha: 0.2 }));
      for (const part of this.visible(options)) {
        if (!part.moves) continue;
        const model = sceneView.pose(part.body, ghost.frame);
        this.renderer.draw(part.mesh, { model, colour: theme.moving, alpha: 0.07 });
        this.renderer.drawLines(part.edges, { model, colour: theme.edge, alpha: 0.22 });
      }
    }
  }

  drawWitness(sceneView, seen, options, theme, column, columns) {
    const found = options.witness ? sceneView.witness(options.mode) : null;
    if (!found) return { witness: null };
    const pixel = (2 * TANGENT * this.camera.distance) / this.renderer.canvas.height, ratio = window.devicePixelRatio || 1;
    const colour = found.broken ? theme.broken : theme.ink, apart = norm(add(found.to, found.from, -1));
    const ends = apart > pixel ? [...found.from, ...found.to] : [...found.from, ...add(found.from, seen.up, pixel)];
    this.renderer.fill(this.pointer, tube(new Float32Array(ends), 1.6 * ratio * pixel, 10));
    this.renderer.draw(this.pointer, { colour, above: true, shine: 0 });
    const at = seenAt(scale(add(found.from, found.to), 0.5), seen, column, columns);
    return { witness: at && { ...found, at } };
  }
}
