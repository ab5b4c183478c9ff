// The map on a canvas: metres in the map frame, x to the right, y up.

const STATUS = { open: "#f0b35a", confirmed: "#5fcf8d", rejected: "#7d8995", unsure: "#b79cff" };
const EXPECTED = "#00dcff";
const OBSERVED = "#ff46d2";
const PAINT = { yellow: "#e2b646", white: "#cfd6dd" };
const SCALES = [0.02, 120]; // pixels a metre, least and most
const PICK_PX = 14;

export class MapView {
  constructor(canvas, { onPick, onScale, onHover }) {
    this.canvas = canvas;
    this.paint = canvas.getContext("2d");
    this.report = { onPick, onScale, onHover };
    this.layers = { lines: true, paths: true, findings: true, expected: true, observed: true };
    this.lines = [];
    this.paths = [];
    this.findings = [];
    this.chosen = null;
    this.view = { x: 0, y: 0, scale: 4 };
    this.fitted = false; // whether the view is still the one of the finding
    this.wanted = false;
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.listen();
    this.resize();
  }

  load(lines, paths) {
    this.lines = lines.map((line) => ({ ...line, box: boxOf(line.points) }));
    this.paths = paths;
    this.redraw();
  }

  resize() {
    const { width, height } = this.canvas.getBoundingClientRect();
    const density = window.devicePixelRatio || 1;
    this.size = [width, height];
    this.canvas.width = Math.max(1, Math.round(width * density));
    this.canvas.height = Math.max(1, Math.round(height * density));
    // The picture of a finding arrives later than the finding, and takes room from the map.
    if (this.fitted) this.showFinding();
    else this.redraw();
  }

  choose(finding) {
    this.chosen = finding;
    this.showFinding();
  }

  showFinding() {
    const points = this.chosen ? [...this.chosen.points, ...this.chosen.expected] : [];
    const place = this.chosen && placeOf(this.chosen);
    if (!place) return this.showAll();
    const box = boxOf([place, ...points]);
    const span = Math.max(box[2] - place[0], place[0] - box[0], box[3] - place[1], place[1] - box[1], 8);
    const scale = Math.min(...this.size) / (3.2 * span);
    this.move(place[0], place[1], Math.min(Math.max(scale, 1.5), 24));
    this.fitted = true;
  }

  showAll() {
    const all = [...this.lines.flatMap((line) => line.points), ...this.paths.flat(), ...this.findings.flatMap((f) => f.points)];
    if (!all.length) return this.redraw();
    const [left, low, right, high] = boxOf(all);
    const [width, height] = this.size;
    const scale = 0.9 * Math.min(width / Math.max(right - left, 1), height / Math.max(high - low, 1));
    this.move((left + right) / 2, (low + high) / 2, scale);
  }

  move(x, y, scale) {
    this.fitted = false;
    this.view = { x, y, scale: Math.min(Math.max(scale, SCALES[0]), SCALES[1]) };
    this.redraw();
  }

  /** Move by a share of the width. */
  pan(right, up) {
    const step = Math.min(...this.size) / 5 / this.view.scale;
    this.move(this.view.x + right * step, this.view.y + up * step, this.view.scale);
  }

  /** Zoom about a place on the canvas that stays where it is; the middle if none is given. */
  zoom(factor, px = this.size[0] / 2, py = this.size[1] / 2) {
    const [x, y] = this.toMap(px, py);
    const scale = Math.min(Math.max(this.view.scale * factor, SCALES[0]), SCALES[1]);
    this.move(x - (px - this.size[0] / 2) / scale, y + (py - this.size[1] / 2) / scale, scale);
  }

  toggle(layer, shown) {
    this.layers[layer] = shown;
    this.redraw();
  }

  toMap(px, py) {
    return [this.view.x + (px - this.size[0] / 2) / this.view.scale, this.view.y - (py - this.size[1] / 2) / this.view.scale];
  }

  toPixels([x, y]) {
    return [this.size[0] / 2 + (x - this.view.x) * this.view.scale, this.size[1] / 2 - (y - this.view.y) * this.view.scale];
  }

  redraw() {
    if (this.wanted) return;
    this.wanted = true;
    requestAnimationFrame(() => {
      this.wanted = false;
      this.draw();
    });
  }

  draw() {
    const [width, height] = this.size;
    const density = window.devicePixelRatio || 1;
    this.paint.setTransform(density, 0, 0, density, 0, 0);
    this.paint.clearRect(0, 0, width, height);
    this.paint.lineCap = "round";
    this.paint.lineJoin = "round";
    if (this.layers.paths) for (const path of this.paths) this.stroke(path, "#4d7fc499", Math.min(Math.max(1.5, 0.4 * this.view.scale), 5), []);
    if (this.layers.lines) this.drawLines();
    if (this.layers.findings) this.drawFindings();
    if (this.chosen) this.drawChosen();
    Object.assign(this.canvas.dataset, { x: this.view.x, y: this.view.y, scale: this.view.scale, lines: this.lines.length });
    this.report.onScale(this.view.scale);
  }

  drawLines() {
    const [left, high] = this.toMap(0, 0);
    const [right, low] = this.toMap(...this.size);
    for (const line of this.lines) {
      const [x1, y1, x2, y2] = line.box;
      if (x2 < left || x1 > right || y2 < low || y1 > high) continue;
      this.drawLine(line);
    }
  }

  drawLine(line) {
    if (!line.painted) return this.stroke(line.points, "#46525e", 1, []);
    const colour = PAINT[line.colour] ?? "#a9b4be";
    const bar = line.kind === "stop_line";
    const width = Math.max(bar ? 2.5 : 1.2, (bar ? 0.4 : 0.15) * this.view.scale);
    const { scale } = this.view;
    const dash = line.type.includes("dashed") ? [Math.max(3, 3 * scale), Math.max(5, 9 * scale)] : [];
    this.paint.lineCap = "butt";
    if (line.type.includes("_")) {
      this.stroke(line.points, colour, 3 * width, line.type === "dashed_dashed" ? dash : []);
      this.stroke(line.points, "#10151a", width, []);
    } else {
      this.stroke(line.points, colour, width, dash);
    }
    this.paint.lineCap = "round";
  }

  drawFindings() {
    for (const finding of this.findings) {
      if (finding === this.chosen || finding.hidden) continue;
      const colour = STATUS[finding.status];
      const place = placeOf(finding);
      if (finding.points.length > 1) this.stroke(finding.points, `${colour}88`, 3, []);
      if (place) this.dot(place, this.view.scale < 1 ? 3 : 4, colour);
    }
  }

  drawChosen() {
    const { points, expected, status } = this.chosen;
    const place = placeOf(this.chosen);
    if (place) {
      const [px, py] = this.toPixels(place);
      this.ring(px, py, 17, "#0e1216aa", 5);
      this.ring(px, py, 17, STATUS[status], 2);
    }
    if (this.layers.observed) this.shape(points, OBSERVED, 4, []);
    if (this.layers.expected) this.shape(expected, EXPECTED, 2, [8, 7]);
  }

  shape(points, colour, width, dash) {
    if (points.length > 1) {
      if (!dash.length) this.stroke(points, "#0e1216", width + 4, []);
      this.stroke(points, colour, width, dash);
    } else if (points.length) {
      this.dot(points[0], 5, colour);
    }
  }

  stroke(points, colour, width, dash) {
    if (points.length < 2) return;
    const { paint } = this;
    paint.beginPath();
    let [lastX, lastY] = [Infinity, Infinity];
    for (const [index, point] of points.entries()) {
      const [px, py] = this.toPixels(point);
      // Points that fall on one pixel cost time and show nothing.
      if (index && index < points.length - 1 && Math.abs(px - lastX) + Math.abs(py - lastY) < 1) continue;
      if (index) paint.lineTo(px, py);
      else paint.moveTo(px, py);
      [lastX, lastY] = [px, py];
    }
    paint.setLineDash(dash);
    paint.strokeStyle = colour;
    paint.lineWidth = width;
    paint.stroke();
    paint.setLineDash([]);
  }

  dot(place, radius, colour) {
    const [px, py] = this.toPixels(place);
    this.paint.beginPath();
    this.paint.arc(px, py, radius, 0, 7);
    this.paint.fillStyle = colour;
    this.paint.fill();
    this.paint.strokeStyle = "#0e1216";
    this.paint.lineWidth = 1;
    this.paint.stroke();
  }

  ring(px, py, radius, colour, width) {
    this.paint.beginPath();
    this.paint.arc(px, py, radius, 0, 7);
    this.paint.strokeStyle = colour;
    this.paint.lineWidth = width;
    this.paint.stroke();
  }

  nearest(px, py) {
    let [best, least] = [null, PICK_PX];
    for (const finding of this.findings) {
      const place = finding.hidden ? null : placeOf(finding);
      if (!place) continue;
      const [x, y] = this.toPixels(place);
      const distance = Math.hypot(x - px, y - py);
      if (distance < least) [best, least] = [finding, distance];
    }
    return best;
  }

  lineAt(px, py) {
    const [x, y] = this.toMap(px, py);
    const reach = 5 / this.view.scale;
    return this.lines.find(
      ({ box, points }) =>
        x > box[0] - reach && x < box[2] + reach && y > box[1] - reach && y < box[3] + reach &&
        points.some((point, index) => index && distanceTo([x, y], points[index - 1], point) < reach),
    );
  }

  listen() {
    const { canvas } = this;
    let held = null;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      held = { x: event.clientX, y: event.clientY, view: { ...this.view }, moved: false };
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!held) return this.report.onHover(event.offsetX, event.offsetY);
      const [dx, dy] = [event.clientX - held.x, event.clientY - held.y];
      if (!held.moved && Math.hypot(dx, dy) < 4) return undefined;
      held.moved = true;
      canvas.classList.add("dragged");
      const { x, y, scale } = held.view;
      return this.move(x - dx / scale, y + dy / scale, scale);
    });
    const release = (event) => {
      const finding = held && !held.moved && event.type === "pointerup" ? this.nearest(event.offsetX, event.offsetY) : null;
      held = null;
      canvas.classList.remove("dragged");
      if (finding) this.report.onPick(finding);
    };
    canvas.addEventListener("pointerup", release);
    canvas.addEventListener("pointercancel", release);
    canvas.addEventListener("pointerleave", () => this.report.onHover(null));
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), event.offsetX, event.offsetY);
      },
      { passive: false },
    );
  }
}

function placeOf(finding) {
  if (finding.x !== null && finding.y !== null) return [finding.x, finding.y];
  return finding.points[0] ?? finding.expected[0] ?? null;
}

function boxOf(points) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (const [x, y] of points) {
    box[0] = Math.min(box[0], x);
    box[1] = Math.min(box[1], y);
    box[2] = Math.max(box[2], x);
    box[3] = Math.max(box[3], y);
  }
  return box;
}

function distanceTo([x, y], [x1, y1], [x2, y2]) {
  const [dx, dy] = [x2 - x1, y2 - y1];
  const along = Math.min(Math.max(((x - x1) * dx + (y - y1) * dy) / (dx * dx + dy * dy || 1), 0), 1);
  return Math.hypot(x - x1 - along * dx, y - y1 - along * dy);
}
