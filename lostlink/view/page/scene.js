// Map and 3-D view of a fleet on one canvas: an orthographic camera, from above or aslant. Frames come over a WebSocket.
import { Marks } from "lostlink-marks";
import { Plan } from "lostlink-plan";

const UNKNOWN = -(2 ** 31), FLASH_MS = 900, FADES = 4, MANY = 12, TRY_AGAIN_LATER = 1013, SILENT_MS = 3000, TRAIL_POINTS = 240, STEPS = 11;
const nice = (x) => { const p = 10 ** Math.floor(Math.log10(x)); return [1, 2, 5, 10].find((k) => k * p >= x) * p; };

export default {
  template: `<canvas ref="canvas" tabindex="0" role="application" :aria-label="label"
    style="display:block;width:100%;height:100%;touch-action:none"></canvas>`,
  props: { label: String, url: String },
  mounted() {
    this.nodes = []; this.trail = []; this.pairs = []; this.quality = []; this.flashes = new Map();
    this.now = this.before = null; this.marks = new Marks(); this.onboard = new Plan();
    this.camera = { north: 0, east: 0, up: 0, scale: 1, azimuth: 0, elevation: Math.PI / 2 };
    this.shown = { trails: true, links: "all", losses: true, wind: true, labels: true, shapes: true, plan: true };
    this.aiming = false; this.notice = ""; this.selected = -1; this.follow = true; this.dirty = true; this.drawn = 0; this.total = 0; this.frames = 0;
    this.observer = new ResizeObserver(() => { this.dirty = true; });
    this.observer.observe(this.$refs.canvas);
    this.listen();
    this.connect();
    const loop = (at) => { this.request = requestAnimationFrame(loop); this.draw(at); };
    this.request = requestAnimationFrame(loop);
    this.beat = setInterval(() => {
      this.$emit("beat", { drawn: this.drawn, frames: this.frames });
      this.drawn = this.frames = 0;
      this.listenFor(performance.now());
    }, 1000);
  },
  unmounted() {
    cancelAnimationFrame(this.request); clearInterval(this.beat); clearTimeout(this.again);
    this.observer.disconnect(); this.gone = true; this.socket?.close();
  },
  methods: {
    connect() {
      const scheme = location.protocol === "https:" ? "wss" : "ws";
      this.socket = new WebSocket(`${scheme}://${location.host}${this.url}`);
      this.socket.onmessage = (event) => this.take(JSON.parse(event.data));
      this.socket.onclose = (event) => {
        if (event.code === TRY_AGAIN_LATER) { this.notice = event.reason; this.came = undefined; }
        this.dirty = true;
        if (!this.gone) this.again = setTimeout(() => this.connect(), 1000);
      };
    },
    listenFor(at) { // frames come ten times a second, also while sim time stands still
      const silent = at - (this.came ?? at);
      if (silent < SILENT_MS) return;
      this.notice = `nothing has come from the view for ${Math.round(silent / 1000)} s: what is seen is old`; this.dirty = true;
    },
    take(frame) {
      this.notice = "";
      if (frame.type === "snapshot") {
        this.nodes = frame.nodes; this.trail = frame.trail; this.before = null;
      } else if (frame.trail) {
        this.trail = this.trail.concat(frame.trail).slice(-TRAIL_POINTS);
      }
      this.marks.take(frame);
      if (frame.links) this.pairs = frame.links;
      if (frame.quality) this.quality = frame.quality;
      const at = performance.now();
      for (let i = 0; i < (frame.lost ?? []).length; i += 3) {
        this.flashes.set(`${frame.lost[i]} ${frame.lost[i + 1]}`, { tx: frame.lost[i], rx: frame.lost[i + 1], at });
      }
      this.before = frame.type === "snapshot" || !this.now ? frame : this.now;
      this.now = frame; this.interval = Math.min(at - (this.came ?? at), 500); this.came = at;
      this.frames += 1; this.dirty = true;
      if (this.follow) this.fit(false);
    },
    // What the buttons and Python call.
    look(kind) {
      this.camera.elevation = kind === "map" ? Math.PI / 2 : Math.PI / 6;
      this.camera.azimuth = kind === "map" ? 0 : Math.PI / 6;
      this.follow = true; this.fit(true);
    },
    show(what, value) { this.shown[what] = value; this.dirty = true; },
    plan(content) { this.onboard.take(content); this.dirty = true; },
    aim(on) { this.aiming = on; this.$refs.canvas.style.cursor = on ? "crosshair" : ""; this.dirty = true; },
    select(number) { this.selected = number; this.dirty = true; },
    zoom(factor) { this.camera.scale *= factor; this.follow = false; this.dirty = true; },
    fit(closer) {
      const places = [...this.trail, this.now?.position ?? [], this.marks.places, this.shown.plan ? this.onboard.places : []].flatMap((p) => this.places(p));
      if (!places.length) return;
      const c = this.camera, size = this.$refs.canvas, box = [Infinity, Infinity, -Infinity, -Infinity];
      const flat = { ...c, scale: 1, north: 0, east: 0, up: 0 };
      const feet = places.map(([north, east]) => [north, east, 0]);
      for (const place of [...places, ...feet]) {
        const [x, y] = this.project(place, flat, 0, 0);
        box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
        box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
      }
      const wide = Math.max(box[2] - box[0], 20), high = Math.max(box[3] - box[1], 20);
      const scale = Math.min((size.clientWidth - 120) / wide, (size.clientHeight - 120) / high);
      if (scale > 0 && (closer || scale < c.scale || scale > 3 * c.scale)) c.scale = scale * (closer ? 1 : 0.85);
      this.centre((box[0] + box[2]) / 2, (box[1] + box[3]) / 2);
      this.dirty = true;
    },
    centre(x, y) { // the place on the ground that is seen at (x, y) of an unscaled view
      const c = this.camera, s = Math.sin(c.elevation);
      const right = x, away = -y / s;
      c.east = right * Math.cos(c.azimuth) + away * Math.sin(c.azimuth);
      c.north = -right * Math.sin(c.azimuth) + away * Math.cos(c.azimuth);
    },
    move(right, away) { // by so many pixels
      const c = this.camera, a = away / c.scale / Math.sin(c.elevation), r = right / c.scale;
      c.east += r * Math.cos(c.azimuth) + a * Math.sin(c.azimuth);
      c.north += -r * Math.sin(c.azimuth) + a * Math.cos(c.azimuth);
      this.follow = false; this.dirty = true;
    },
    turn(azimuth, elevation) {
      const c = this.camera;
      c.azimuth += azimuth;
      c.elevation = Math.min(Math.PI / 2, Math.max(0.15, c.elevation + elevation));
      this.dirty = true;
    },
    listen() {
      const canvas = this.$refs.canvas, keys = {
        ArrowLeft: () => this.move(-40, 0), ArrowRight: () => this.move(40, 0),
        ArrowUp: () => this.move(0, 40), ArrowDown: () => this.move(0, -40),
        "+": () => this.zoom(1.25), "-": () => this.zoom(0.8), f: () => { this.follow = true; this.fit(true); },
        m: () => this.look("map"), t: () => this.look("3d"),
        PageUp: () => this.turn(0, 0.1), PageDown: () => this.turn(0, -0.1),
        Home: () => this.turn(-0.1, 0), End: () => this.turn(0.1, 0),
        Enter: () => this.aiming && this.aimAt(this.width / 2, this.height / 2), Escape: () => this.aiming && this.leave(),
        n: () => this.pick((this.selected + 1) % this.nodes.length),
        p: () => this.pick((this.selected + this.nodes.length - (this.selected < 0 ? 0 : 1)) % this.nodes.length),
      };
      canvas.addEventListener("keydown", (e) => {
        if (!keys[e.key] || e.ctrlKey || e.metaKey || e.altKey) return;
        e.preventDefault(); keys[e.key]();
      });
      canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(e.deltaY < 0 ? 1.15 : 0.87); }, { passive: false });
      canvas.addEventListener("pointerdown", (e) => {
        this.drag = { x: e.clientX, y: e.clientY, far: 0 }; canvas.setPointerCapture(e.pointerId);
      });
      canvas.addEventListener("pointermove", (e) => {
        if (!this.drag) return;
        const dx = e.clientX - this.drag.x, dy = e.clientY - this.drag.y;
        this.drag = { x: e.clientX, y: e.clientY, far: this.drag.far + Math.abs(dx) + Math.abs(dy) };
        if (e.shiftKey || e.buttons & 2) this.turn(dx / 200, dy / 200); else this.move(-dx, dy);
      });
      canvas.addEventListener("pointerup", (e) => {
        const isClick = this.drag?.far < 4;
        if (isClick && this.aiming) this.aimAt(e.offsetX, e.offsetY);
        else if (isClick) this.pickAt(e.offsetX, e.offsetY);
        this.drag = null;
      });
      canvas.addEventListener("pointercancel", () => { this.drag = null; });
      canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    },
    pick(number) { this.select(number); this.$emit("pick", number); },
    aimAt(x, y) { // a place on the ground was chosen to go to
      const c = this.camera, right = (x - this.width / 2) / c.scale, away = (this.height / 2 - y) / c.scale / Math.sin(c.elevation);
      const north = c.north - right * Math.sin(c.azimuth) + away * Math.cos(c.azimuth);
      const east = c.east + right * Math.cos(c.azimuth) + away * Math.sin(c.azimuth);
      this.leave(); this.$emit("aimed", { north, east });
    },
    leave() { this.aim(false); this.$emit("unaimed"); },
    pickAt(x, y) {
      const far = (this.seen ?? []).map((p) => (p ? Math.hypot(p[0] - x, p[1] - y) : Infinity));
      const nearest = far.indexOf(Math.min(...far));
      this.pick(far[nearest] < 16 ? nearest : -1);
    },
    // From places (north, east, up in metres) to pixels.
    places(flat) {
      const out = [];
      for (let i = 0; i < flat.length; i += 3) {
        if (flat[i] !== UNKNOWN) out.push([flat[i] / 10, flat[i + 1] / 10, -flat[i + 2] / 10]);
      }
      return out;
    },
    project([north, east, up], c = this.camera, x0 = this.width / 2, y0 = this.height / 2) {
      const n = north - c.north, e = east - c.east, ca = Math.cos(c.azimuth), sa = Math.sin(c.azimuth);
      const right = e * ca - n * sa, away = e * sa + n * ca;
      return [x0 + right * c.scale, y0 - (away * Math.sin(c.elevation) + up * Math.cos(c.elevation)) * c.scale];
    },
    at(i) { // between the last two frames, so that it moves smoothly
      const a = this.before?.position, b = this.now?.position;
      if (!b || b[3 * i] === UNKNOWN || b[3 * i] === undefined) return null;
      const from = a && a[3 * i] !== UNKNOWN && a[3 * i] !== undefined ? a : b;
      const mix = (k) => (from[3 * i + k] + (b[3 * i + k] - from[3 * i + k]) * this.share) / 10;
      return [mix(0), mix(1), -mix(2)];
    },
    // Drawing.
    draw(at) {
      const canvas = this.$refs.canvas;
      this.share = this.interval ? Math.min(1, Math.max(0, at - this.came) / this.interval) : 1;
      this.flashes.forEach((flash, link) => { if (at - flash.at >= FLASH_MS) this.flashes.delete(link); });
      if (!this.dirty && !this.moving && !this.flashes.size) return;
      this.moving = this.share < 1; this.dirty = false;
      const ratio = window.devicePixelRatio || 1;
      this.width = canvas.clientWidth; this.height = canvas.clientHeight;
      if (canvas.width !== Math.round(this.width * ratio) || canvas.height !== Math.round(this.height * ratio)) {
        canvas.width = Math.round(this.width * ratio); canvas.height = Math.round(this.height * ratio);
      }
      const g = (this.g = canvas.getContext("2d"));
      g.setTransform(ratio, 0, 0, ratio, 0, 0);
      this.readColours();
      g.fillStyle = this.ground; g.fillRect(0, 0, this.width, this.height);
      g.font = "12px sans-serif"; g.lineWidth = 1;
      this.seen = this.nodes.map((_, i) => this.at(i)).map((place) => place && this.project(place));
      this.drawGrid();
      if (this.shown.trails) this.drawTrails();
      if (this.shown.shapes) this.marks.drawShapes(this);
      if (this.shown.plan) this.onboard.draw(this);
      if (this.shown.links !== "none") this.drawLinks();
      if (this.shown.losses) this.drawLosses(at);
      this.marks.drawEmitters(this);
      this.drawNodes();
      if (this.shown.labels) this.marks.drawLabels(this);
      this.drawCorner();
      if (this.aiming) this.drawAim();
      if (this.notice) { g.fillStyle = this.ink; g.fillText(this.notice, 16, 24); }
      this.drawn += 1; this.total += 1;
    },
    readColours() {
      const theme = document.body.className;
      if (theme === this.theme) return;
      const style = getComputedStyle(this.$refs.canvas), colour = (name) => style.getPropertyValue(name).trim();
      this.theme = theme;
      this.ink = colour("--ll-ink"); this.faint = colour("--ll-faint"); this.accent = colour("--ll-accent");
      this.bad = colour("--ll-loss"); this.planColour = colour("--ll-plan"); this.ground = colour("--ll-ground"); this.steps = colour("--ll-steps").split(",");
      this.nodeColours = colour("--ll-nodes").split(",");
    },
    line(a, b) { this.g.moveTo(a[0], a[1]); this.g.lineTo(b[0], b[1]); },
    drawGrid() {
      const g = this.g, c = this.camera, step = nice(80 / c.scale);
      const reach = Math.ceil(Math.hypot(this.width, this.height / Math.sin(c.elevation)) / c.scale / 2 / step + 1);
      const n0 = Math.round(c.north / step), e0 = Math.round(c.east / step);
      g.strokeStyle = this.faint; g.beginPath();
      for (let k = -reach; k <= reach; k++) {
        this.line(this.project([(n0 + k) * step, (e0 - reach) * step, 0]), this.project([(n0 + k) * step, (e0 + reach) * step, 0]));
        this.line(this.project([(n0 - reach) * step, (e0 + k) * step, 0]), this.project([(n0 + reach) * step, (e0 + k) * step, 0]));
      }
      g.stroke();
      this.gridStep = step;
    },
    drawTrails() {
      const g = this.g;
      g.strokeStyle = this.accent; g.globalAlpha = 0.45; g.beginPath();
      for (let i = 0; i < this.nodes.length; i++) {
        let last = null;
        for (const points of this.trail) {
          if (points[3 * i] === UNKNOWN) continue;
          const here = this.project([points[3 * i] / 10, points[3 * i + 1] / 10, -points[3 * i + 2] / 10]);
          if (last) this.line(last, here);
          last = here;
        }
        const now = this.at(i);
        if (last && now) this.line(last, this.project(now));
      }
      g.stroke(); g.globalAlpha = 1;
    },
    isShown(tx, rx) { return this.shown.links === "all" || tx === this.selected || rx === this.selected; },
    drawLinks() { // each direction colours its half of the line, the one at its sender
      const g = this.g, byStep = Array.from({ length: STEPS }, () => []);
      const seen = this.seen, many = this.nodes.length > MANY;
      for (let i = 0; i < this.quality.length; i++) {
        const tx = this.pairs[2 * i], rx = this.pairs[2 * i + 1], percent = this.quality[i];
        if (percent < 0 || !seen[tx] || !seen[rx] || !this.isShown(tx, rx)) continue;
        byStep[Math.round((percent / 100) * (STEPS - 1))].push(seen[tx], seen[rx]);
      }
      g.lineWidth = many ? 1 : 2.5;
      byStep.forEach((ends, step) => {
        if (!ends.length) return;
        g.strokeStyle = this.steps[step]; g.setLineDash(!many && step < (STEPS - 1) / 2 ? [5, 5] : []); g.beginPath();
        for (let i = 0; i < ends.length; i += 2) {
          const a = ends[i], b = ends[i + 1];
          this.line(a, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
        }
        g.stroke();
      });
      g.setLineDash([]); g.lineWidth = 1;
    },
    drawLosses(at) { // a cross near the receiver that did not get it, which fades
      const g = this.g, ages = Array.from({ length: FADES }, () => []);
      for (const flash of this.flashes.values()) {
        if (!this.seen[flash.tx] || !this.seen[flash.rx] || !this.isShown(flash.tx, flash.rx)) continue;
        const age = Math.floor((Math.max(0, at - flash.at) / FLASH_MS) * FADES); // a frame begins before what it shows
        ages[Math.min(FADES - 1, age)].push(flash);
      }
      g.strokeStyle = this.bad; g.lineWidth = 2;
      ages.forEach((flashes, age) => {
        g.globalAlpha = 1 - age / FADES; g.beginPath();
        for (const { tx, rx } of flashes) {
          const p = this.seen[tx], q = this.seen[rx], far = Math.hypot(q[0] - p[0], q[1] - p[1]);
          const part = far > 60 ? 1 - 24 / far : 0.7, x = p[0] + (q[0] - p[0]) * part, y = p[1] + (q[1] - p[1]) * part;
          this.line([x - 4, y - 4], [x + 4, y + 4]); this.line([x - 4, y + 4], [x + 4, y - 4]);
        }
        g.stroke();
      });
      g.globalAlpha = 1; g.lineWidth = 1;
    },
    drawNodes() {
      const g = this.g, aslant = this.camera.elevation < 1.5;
      this.nodes.forEach((node, i) => {
        const place = this.at(i);
        if (!place) return;
        const [x, y] = this.project(place), chosen = i === this.selected;
        g.strokeStyle = this.ink; g.fillStyle = this.marks.colour(this, i);
        if (aslant && place[2] > 1) {
          g.globalAlpha = 0.35; g.beginPath(); this.line([x, y], this.project([place[0], place[1], 0])); g.stroke(); g.globalAlpha = 1;
        }
        g.beginPath();
        if (node.kind === "ground") g.rect(x - 5, y - 5, 10, 10);
        else this.arrow(x, y, place, (this.now.heading[i] ?? 0) / 1000);
        if (this.now.off?.includes(i)) this.silent(x, y); else g.fill();
        if (chosen) { g.strokeStyle = this.accent; g.lineWidth = 2; g.beginPath(); g.arc(x, y, 14, 0, 7); g.stroke(); g.lineWidth = 1; }
        if (this.shown.labels) { g.fillStyle = this.ink; g.fillText(node.id, x + 11, y - 7); }
        if (this.shown.wind) this.drawWind(x, y, i);
      });
    },
    silent(x, y) { // its radio is off: hollow, and struck through
      const g = this.g;
      g.stroke(); g.strokeStyle = this.bad; g.lineWidth = 2; g.beginPath(); this.line([x - 10, y + 10], [x + 10, y - 10]); g.stroke();
      g.lineWidth = 1;
    },
    arrow(x, y, place, heading) { // points where the nose does, as seen
      const ahead = this.project([place[0] + Math.cos(heading), place[1] + Math.sin(heading), place[2]]);
      const angle = Math.atan2(ahead[1] - y, ahead[0] - x), corner = (turn, far) => [x + far * Math.cos(angle + turn), y + far * Math.sin(angle + turn)];
      const points = [corner(0, 11), corner(2.5, 9), corner(Math.PI, 4), corner(-2.5, 9)];
      this.g.moveTo(...points[0]); points.slice(1).forEach((p) => this.g.lineTo(...p)); this.g.closePath();
    },
    drawWind(x, y, i) { // where the air goes: ten pixels per m/s
      const wind = this.now.wind, n = wind[3 * i] / 100, e = wind[3 * i + 1] / 100;
      if (wind[3 * i] === UNKNOWN || Math.hypot(n, e) < 0.1) return;
      const c = { ...this.camera, north: 0, east: 0, scale: 10 }, [wx, wy] = this.project([n, e, 0], c, x, y);
      this.g.strokeStyle = this.accent; this.g.beginPath(); this.line([x, y], [wx, wy]); this.g.stroke();
      this.g.beginPath(); this.g.arc(wx, wy, 2, 0, 7); this.g.stroke();
    },
    drawCorner() { // scale, and where north is
      const g = this.g, wide = this.gridStep * this.camera.scale, y = this.height - 14;
      g.strokeStyle = g.fillStyle = this.ink; g.lineWidth = 2; g.beginPath();
      this.line([14, y], [14 + wide, y]); g.stroke(); g.lineWidth = 1;
      g.fillText(this.gridStep >= 1000 ? `${this.gridStep / 1000} km` : `${this.gridStep} m`, 16, y - 6);
      const c = { ...this.camera, north: 0, east: 0, scale: 22 }, [x1, y1] = this.project([1, 0, 0], c, this.width - 34, 40);
      g.beginPath(); this.line([this.width - 34, 40], [x1, y1]); g.stroke(); g.fillText("N", x1 - 4, y1 - 4);
    },
    drawAim() { // where Enter aims at
      const g = this.g, x = this.width / 2, y = this.height / 2;
      g.strokeStyle = this.accent; g.lineWidth = 2; g.beginPath();
      this.line([x - 14, y], [x + 14, y]); this.line([x, y - 14], [x, y + 14]); g.stroke(); g.lineWidth = 1;
    },
    words() { // for tests and for whoever wants to know: what is drawn, in words
      return {
        nodes: this.nodes.map((node, i) => ({ id: node.id, place: this.at(i), pixel: this.at(i) && this.project(this.at(i)),
          radio: this.now?.off?.includes(i) ? "off" : "on" })),
        links: this.quality.map((percent, i) => ({ tx: this.nodes[this.pairs[2 * i]]?.id, rx: this.nodes[this.pairs[2 * i + 1]]?.id, percent,
          colour: this.steps?.[Math.round((percent / 100) * (STEPS - 1))] })),
        trail: this.trail.length, losses: this.flashes.size, time: this.now?.time, elevation: this.camera.elevation,
        ...this.marks.words(), ...this.onboard.words(), aiming: this.aiming, notice: this.notice,
      };
    },
  },
};
