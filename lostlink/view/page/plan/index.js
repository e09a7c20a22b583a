// What the chosen UA has on board: home, where it was told to go, mission, fence, rally points. All in dm, NED.
const DM = 10, CORNERS = 64, RING = 9;

const pairs = (numbers) => Array.from({ length: numbers.length / 2 }, (_, i) => numbers.slice(2 * i, 2 * i + 2));
const around = ([north, east, radius]) => [[north - radius, east - radius], [north + radius, east + radius]];

export class Plan {
  constructor() { this.content = {}; }
  take(content) { this.content = content; }

  at([north, east, down = 0]) { return [north / DM, east / DM, -down / DM]; }
  get places() { // what the map is fitted to
    const { home, target, items = [], fence = [], rally = [] } = this.content;
    const ends = fence.flatMap(({ polygon, circle }) => (polygon ? pairs(polygon) : circle ? around(circle) : []));
    const ground = [...(target ? [target] : []), ...ends].map((place) => [...place, 0]);
    return [...(home ? [home] : []), ...ground, ...items.map((item) => item.at), ...rally].flat();
  }

  draw(scene) {
    const g = scene.g, { home, target, items = [], fence = [], rally = [], current } = this.content;
    fence.forEach((part) => this.drawFence(scene, part));
    this.drawWay(scene, items);
    g.lineWidth = 1.5;
    rally.forEach((place) => this.drawLetter(scene, place, "R", scene.accent));
    if (home) this.drawLetter(scene, home, "H", scene.ink);
    let beside = 0;
    items.forEach((item) => this.drawItem(scene, item, item.number === current, item.beside ? (beside += 1) : 0));
    if (target) this.drawTarget(scene, target);
    g.lineWidth = 1;
  }
  drawWay(scene, items) {
    const g = scene.g, way = items.filter((item) => item.way).map((item) => scene.project(this.at(item.at)));
    g.strokeStyle = scene.planColour; g.lineWidth = 2; g.beginPath();
    way.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y)));
    g.stroke();
  }
  drawItem(scene, { number, at }, isCurrent, beside) { // a disc with its number; the current one is filled
    const g = scene.g, [x0, y] = scene.project(this.at(at)), x = x0 + 20 * beside;
    if (!beside) this.foot(scene, at, x, y);
    g.beginPath(); g.arc(x, y, RING, 0, 7);
    g.fillStyle = isCurrent ? scene.planColour : scene.ground; g.fill(); g.strokeStyle = scene.planColour; g.stroke();
    this.text(scene, number, x, y, isCurrent ? scene.ground : scene.ink);
  }
  drawLetter(scene, at, letter, colour) { // a square
    const g = scene.g, [x, y] = scene.project(this.at(at));
    g.beginPath(); g.rect(x - 8, y - 8, 16, 16);
    g.fillStyle = scene.ground; g.fill(); g.strokeStyle = colour; g.stroke();
    this.text(scene, letter, x, y, colour);
  }
  text(scene, text, x, y, colour) {
    const g = scene.g;
    g.save(); g.textAlign = "center"; g.textBaseline = "middle"; g.fillStyle = colour; g.fillText(text, x, y + 0.5); g.restore();
  }
  foot(scene, at, x, y) {
    const g = scene.g, [north, east, up] = this.at(at);
    if (scene.camera.elevation >= 1.5 || up <= 1) return;
    g.globalAlpha = 0.35; g.strokeStyle = scene.planColour; g.beginPath(); scene.line([x, y], scene.project([north, east, 0])); g.stroke();
    g.globalAlpha = 1;
  }
  drawTarget(scene, target) { // a ring with a cross
    const g = scene.g, [x, y] = scene.project(this.at(target));
    g.strokeStyle = scene.accent; g.lineWidth = 2; g.beginPath(); g.arc(x, y, 7, 0, 7); g.stroke();
    g.beginPath(); scene.line([x - 12, y], [x + 12, y]); scene.line([x, y - 12], [x, y + 12]); g.stroke();
  }
  drawFence(scene, { inside, polygon, circle, back }) { // to stay inside: solid; to stay out: dashed, and filled
    const g = scene.g;
    if (back) { this.drawLetter(scene, back, "B", scene.bad); return; }
    const corners = polygon ? this.corners(polygon) : this.round(circle);
    g.strokeStyle = g.fillStyle = scene.bad; g.lineWidth = 2; g.setLineDash(inside ? [] : [6, 4]); g.beginPath();
    corners.map((place) => scene.project(place)).forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y)));
    g.closePath(); g.stroke(); g.setLineDash([]);
    if (!inside) { g.globalAlpha = 0.15; g.fill(); g.globalAlpha = 1; }
  }
  corners(polygon) {
    return pairs(polygon).map((place) => this.at(place));
  }
  round([north, east, radius]) {
    return Array.from({ length: CORNERS }, (_, i) => {
      const turn = (2 * Math.PI * i) / CORNERS;
      return this.at([north + radius * Math.cos(turn), east + radius * Math.sin(turn)]);
    });
  }

  words() { return { plan: this.content }; } // what is drawn, in words
}
