// The mission on the map: emitters, and what agents log as 95 % ellipses (estimates) and dashed lines (plans).
const UNKNOWN = -(2 ** 31), CORNERS = 48, DM = 10, LABEL_MAX = 28, LABELS_MAX = 24, LINE_HEIGHT = 14, TRIES = 8;

export class Marks {
  constructor() { this.emitters = []; this.places = []; this.shapes = new Map(); }

  take(frame) {
    if (frame.type === "snapshot") { this.emitters = frame.emitters ?? []; this.shapes.clear(); }
    if (frame.emitterPlaces) this.places = frame.emitterPlaces;
    for (const shape of frame.shapes ?? []) {
      const key = `${shape.node} ${shape.name}`;
      if (shape.ellipse || shape.line) this.shapes.set(key, { ...shape, points: this.points(shape) }); else this.shapes.delete(key);
    }
  }

  colour(scene, node) { // of a node, and of what it logs
    return scene.nodeColours[node % scene.nodeColours.length];
  }

  emitterPlace(i) {
    const [north, east, down] = this.places.slice(3 * i, 3 * i + 3);
    return north === undefined || north === UNKNOWN ? null : [north / DM, east / DM, -down / DM];
  }
  points(shape) { // on the ground: north, east, up in metres
    if (shape.line) {
      return Array.from({ length: shape.line.length / 2 }, (_, i) => [shape.line[2 * i] / DM, shape.line[2 * i + 1] / DM, 0]);
    }
    const [north, east, major, minor] = shape.ellipse.slice(0, 4).map((x) => x / DM), azimuth = shape.ellipse[4] / 1000;
    const c = Math.cos(azimuth), s = Math.sin(azimuth);
    return Array.from({ length: CORNERS }, (_, i) => {
      const a = major * Math.cos((2 * Math.PI * i) / CORNERS), b = minor * Math.sin((2 * Math.PI * i) / CORNERS);
      return [north + a * c - b * s, east + a * s + b * c, 0];
    });
  }

  drawEmitters(scene) { // a mast that radiates
    const g = scene.g;
    g.strokeStyle = g.fillStyle = scene.ink;
    this.emitters.forEach((id, i) => {
      const place = this.emitterPlace(i);
      if (!place) return;
      const [x, y] = scene.project(place);
      if (scene.camera.elevation < 1.5 && place[2] > 1) {
        g.globalAlpha = 0.35; g.beginPath(); scene.line([x, y], scene.project([place[0], place[1], 0])); g.stroke(); g.globalAlpha = 1;
      }
      g.lineWidth = 1.5;
      g.beginPath(); g.arc(x, y, 2.5, 0, 7); g.fill();
      g.beginPath(); g.moveTo(x - 5, y + 10); g.lineTo(x, y); g.lineTo(x + 5, y + 10); g.closePath(); g.stroke();
      for (const radius of [6, 10]) {
        g.beginPath(); g.arc(x, y, radius, -0.7, 0.7); g.stroke();
        g.beginPath(); g.arc(x, y, radius, Math.PI - 0.7, Math.PI + 0.7); g.stroke();
      }
      g.lineWidth = 1;
    });
  }

  drawShapes(scene) {
    const g = scene.g;
    for (const shape of this.shapes.values()) {
      const points = shape.points.map((place) => scene.project(place));
      g.strokeStyle = g.fillStyle = this.colour(scene, shape.node); g.lineWidth = 2; g.beginPath();
      points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y)));
      if (shape.line) {
        g.setLineDash([7, 5]); g.stroke(); g.setLineDash([]);
        const [x, y] = points[points.length - 1];
        g.beginPath(); g.arc(x, y, 3.5, 0, 7); g.stroke();
      } else {
        g.closePath(); g.globalAlpha = 0.1; g.fill(); g.globalAlpha = 1; g.stroke();
        const [x, y] = scene.project([shape.ellipse[0] / DM, shape.ellipse[1] / DM, 0]);
        g.beginPath(); scene.line([x - 4, y], [x + 4, y]); scene.line([x, y - 4], [x, y + 4]); g.stroke();
      }
      g.lineWidth = 1;
    }
  }

  drawLabels(scene) { // where they cover neither each other nor the names of nodes
    const taken = scene.seen.filter((p) => p).map(([x, y]) => ({ x: x - 8, y: y - 7, wide: 30 }));
    this.emitters.forEach((id, i) => {
      const place = this.emitterPlace(i);
      if (!place) return;
      const [x, y] = scene.project(place), wide = scene.g.measureText(id).width;
      this.label(scene, id, { x: x - wide / 2, y: y + 24, wide }, scene.ink, taken);
    });
    if (!scene.shown.shapes) return;
    const few = this.shapes.size <= LABELS_MAX; // of many only those of the chosen node have names
    for (const shape of this.shapes.values()) if (few || shape.node === scene.selected) this.labelShape(scene, shape, taken);
  }
  labelShape(scene, shape, taken) { // beside the end of a line, or the rightmost point of an ellipse that is in sight
    const text = `${scene.nodes[shape.node]?.id} ${shape.name}`.slice(0, LABEL_MAX), wide = scene.g.measureText(text).width;
    const points = shape.points.map((place) => scene.project(place));
    const inSight = points.filter(([x, y]) => x > 0 && x + wide + 8 < scene.width && y > LINE_HEIGHT && y < scene.height);
    if (!inSight.length) return;
    const [x, y] = shape.line ? inSight[inSight.length - 1] : inSight.reduce((a, b) => (b[0] > a[0] ? b : a));
    this.label(scene, text, { x: x + 7, y: y + 4, wide }, this.colour(scene, shape.node), taken);
  }
  label(scene, text, box, colour, taken) { // below what is there already; with a rim, so that it is read over lines
    const g = scene.g, hits = (other) => Math.abs(other.y - box.y) < LINE_HEIGHT && box.x < other.x + other.wide && other.x < box.x + box.wide;
    for (let tries = 0; tries < TRIES && taken.some(hits); tries++) box.y += LINE_HEIGHT;
    taken.push(box);
    g.lineWidth = 3; g.strokeStyle = scene.ground; g.strokeText(text, box.x, box.y); g.lineWidth = 1;
    g.fillStyle = colour; g.fillText(text, box.x, box.y);
  }

  words() { // what is drawn, in words
    return {
      emitters: this.emitters.map((id, i) => ({ id, place: this.emitterPlace(i) })),
      shapes: [...this.shapes.values()].map(({ points, ...shape }) => shape),
    };
  }
}
