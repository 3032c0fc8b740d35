// Replays runs in 3-D. `THREE` is the bundle before this script; view.rs writes the runs into #view-data.
"use strict";
(() => {
  const byId = (id) => document.getElementById(`view-${id}`);
  const canvas = byId("canvas");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const still = matchMedia("(prefers-reduced-motion: reduce)");

  const LIGHT = { ground: 0xeef1f4, body: 0xb9c6d3, line: 0x5f7183, fixed: 0x2b343d, patch: 0xd95f0e, tip: 0x185a9d, force: 0xb01030 };
  const DARK = { ground: 0x15191e, body: 0x5d6f82, line: 0x9fb2c4, fixed: 0x0a0c0e, patch: 0xffa04d, tip: 0x7db8f5, force: 0xff6b81 };

  /** Decodes 16-bit numbers in base 64, lower byte first. */
  function numbers(text) {
    const bytes = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    return new Uint16Array(bytes.buffer);
  }

  /** A run: positions of its vertices, its tip and its force in each frame. */
  class Run {
    constructor(data) {
      Object.assign(this, data);
      this.frames = data.time_s.length;
      this.largestForce = Math.max(...data.force_n.map((force) => Math.hypot(...force)), 1e-9);
      this.steps = numbers(data.positions);
      const first = numbers(data.first);
      this.vertices = new Float32Array(first.length);
      first.forEach((steps, i) => { this.vertices[i] = this.metres(steps, i % 3); });
    }

    metres(steps, axis) {
      return this.origin_m[axis] + this.step_m * steps;
    }

    /** Sets `vertices` to their positions in a frame. */
    place(frame) {
      const from = 3 * this.moving.length * frame;
      this.moving.forEach((vertex, k) => {
        for (let axis = 0; axis < 3; axis += 1) {
          this.vertices[3 * vertex + axis] = this.metres(this.steps[from + 3 * k + axis], axis);
        }
      });
    }

    /** Returns the vertices of the patch in use in a frame. */
    patch(frame) {
      return this.patches.findLast((patch) => patch.frame <= frame).vertices;
    }

    words(frame) {
      const newtons = (force) => `${force.toFixed(2)} N`;
      const normal = this.normal_force_n[frame];
      const tangential = this.tangential_force_n[frame];
      const end = frame === this.frames - 1 ? ` · ${this.outcome}` : "";
      return `t = ${this.time_s[frame].toFixed(3)} s · ${this.mode[frame]} · normal ${newtons(normal)} · tangential ${newtons(tangential)}${end}`;
    }
  }

  /** Returns the ends of the edges of triangles, each edge once. */
  function edges(triangles) {
    const seen = new Set();
    const ends = [];
    for (const [a, b, c] of triangles) {
      for (const [from, to] of [[a, b], [b, c], [c, a]]) {
        const key = from < to ? `${from} ${to}` : `${to} ${from}`;
        if (!seen.has(key)) {
          seen.add(key);
          ends.push(from, to);
        }
      }
    }
    return ends;
  }

  /** The drawn objects of one run. All parts share the positions of its vertices. */
  class Model {
    constructor(run, colours) {
      this.run = run;
      this.scene = new THREE.Scene();
      this.scene.background = new THREE.Color(colours.ground);
      this.positions = new THREE.BufferAttribute(run.vertices, 3);
      const share = (index) => {
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", this.positions);
        geometry.setIndex(index);
        return geometry;
      };
      const body = share(run.triangles.flat());
      body.computeBoundingSphere();
      this.centre = body.boundingSphere.center.clone();
      this.radius = body.boundingSphere.radius;
      const dot = 0.018 * this.radius;
      const nodes = (most, color) => {
        const drawn = new THREE.InstancedMesh(new THREE.SphereGeometry(dot, 12, 8), new THREE.MeshLambertMaterial({ color }), most);
        drawn.frustumCulled = false;
        return drawn;
      };
      const surface = new THREE.Mesh(body, new THREE.MeshLambertMaterial({
        color: colours.body, flatShading: true, side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
      }));
      const lines = new THREE.LineSegments(share(edges(run.triangles)), new THREE.LineBasicMaterial({ color: colours.line }));
      this.patch = nodes(run.moving.length, colours.patch);
      this.fixed = nodes(run.fixed.length, colours.fixed);
      // Tip and force stay visible through the walls of the indentation.
      this.tip = new THREE.Mesh(new THREE.SphereGeometry(1.3 * dot, 24, 16), new THREE.MeshLambertMaterial({ color: colours.tip, depthTest: false }));
      this.tip.renderOrder = 1;
      this.arrow = new THREE.Group();
      const paint = new THREE.MeshLambertMaterial({ color: colours.force, depthTest: false });
      // The arrow is along y, with length 1.
      const shaft = new THREE.Mesh(new THREE.CylinderGeometry(1, 1, 0.8, 16).translate(0, 0.4, 0), paint);
      const head = new THREE.Mesh(new THREE.ConeGeometry(2.4, 0.2, 24).translate(0, 0.9, 0), paint);
      shaft.renderOrder = 1;
      head.renderOrder = 1;
      this.arrow.add(shaft, head);
      this.scene.add(surface, lines, this.fixed, this.patch, this.tip, this.arrow);
      this.mark(this.fixed, run.fixed);
      for (const drawn of [surface, lines]) drawn.frustumCulled = false;
      const sun = new THREE.DirectionalLight(0xffffff, 2.2);
      sun.position.set(0.6, -0.9, 1.6);
      this.scene.add(new THREE.AmbientLight(0xffffff, 1.3), sun);
    }

    /** Puts a ball on each vertex of a list. */
    mark(balls, vertices) {
      const place = new THREE.Matrix4();
      balls.count = vertices.length;
      vertices.forEach((vertex, k) => balls.setMatrixAt(k, place.makeTranslation(...this.run.vertices.slice(3 * vertex, 3 * vertex + 3))));
      balls.instanceMatrix.needsUpdate = true;
    }

    show(frame) {
      const { run } = this;
      run.place(frame);
      this.positions.needsUpdate = true;
      this.mark(this.patch, run.patch(frame));
      this.tip.position.set(...run.tip_m[frame]);
      const force = new THREE.Vector3(...run.force_n[frame]);
      const length = 0.8 * this.radius * force.length() / run.largestForce;
      this.arrow.visible = length > 0;
      if (this.arrow.visible) {
        this.arrow.position.copy(this.tip.position);
        this.arrow.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), force.normalize());
        const width = 0.008 * this.radius;
        this.arrow.scale.set(width, length, width);
      }
    }

    dispose() {
      this.scene.traverse((drawn) => {
        drawn.geometry?.dispose();
        drawn.material?.dispose();
      });
    }
  }

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
  } catch {
    // #view-none states the reason.
    return;
  }
  byId("none").hidden = true;
  byId("stage").hidden = false;

  const runs = JSON.parse(byId("data").textContent);
  const camera = new THREE.PerspectiveCamera(35, 1, 0.001, 100);
  camera.up.set(0, 0, 1);
  const controls = new THREE.OrbitControls(camera, canvas);
  const opened = new Map();
  let model;
  let frame = 0;
  let playing = false;
  /** Simulated time while playing, s, and the time of its last update, ms. */
  let clock = 0;
  let lookedAt = 0;
  let waiting = false;

  /** Requests a frame, once for all changes before it. */
  function draw() {
    if (!waiting) {
      waiting = true;
      requestAnimationFrame(picture);
    }
  }

  function picture(now) {
    waiting = false;
    if (playing) {
      advance(now);
      draw();
    }
    renderer.render(model.scene, camera);
  }

  function advance(now) {
    const { time_s: times, frames } = model.run;
    clock += 1e-3 * (now - lookedAt) * Number(byId("speed").value);
    lookedAt = now;
    // After the end, wait 0.2 s and start again.
    if (clock > times[frames - 1] + 0.2) clock = times[0];
    let next = frame;
    if (times[next] > clock) next = 0;
    while (next + 1 < frames && times[next + 1] <= clock) next += 1;
    if (next !== frame) show(next);
  }

  function show(next) {
    frame = next;
    model.show(frame);
    const words = model.run.words(frame);
    byId("text").textContent = words;
    byId("time").value = frame;
    byId("time").setAttribute("aria-valuetext", words);
    draw();
  }

  function play(on) {
    playing = on;
    byId("play").textContent = on ? "Pause" : "Play";
    lookedAt = performance.now();
    clock = model.run.time_s[frame];
    draw();
  }

  function step(by) {
    play(false);
    show(Math.min(Math.max(frame + by, 0), model.run.frames - 1));
  }

  function aim() {
    const away = new THREE.Vector3(0.55, -1, 0.75).normalize().multiplyScalar(3.1 * model.radius);
    controls.target.copy(model.centre);
    camera.position.copy(model.centre).add(away);
    camera.near = 0.01 * model.radius;
    camera.far = 100 * model.radius;
    camera.updateProjectionMatrix();
    controls.update();
  }

  /** Turns the camera about the centre of the body and scales its distance. */
  function turn(around, up, factor) {
    const away = camera.position.clone().sub(controls.target);
    const length = away.length() * factor;
    const height = Math.asin(away.z / away.length());
    const limit = Math.min(Math.max(height + up, -1.5), 1.5);
    const heading = Math.atan2(away.y, away.x) + around;
    away.set(Math.cos(heading) * Math.cos(limit), Math.sin(heading) * Math.cos(limit), Math.sin(limit));
    camera.position.copy(controls.target).addScaledVector(away, length);
    controls.update();
    draw();
  }

  function open(index) {
    if (!opened.has(index)) opened.set(index, new Run(runs[index]));
    model?.dispose();
    model = new Model(opened.get(index), dark.matches ? DARK : LIGHT);
    canvas.setAttribute("aria-label", `The mesh under the tip in the scene ${model.run.scene}`);
    byId("time").max = model.run.frames - 1;
  }

  function fit() {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (width === 0 || height === 0) return;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    // Draw at once: a resized canvas is empty.
    renderer.render(model.scene, camera);
  }

  const keys = {
    ArrowLeft: () => turn(-0.1, 0, 1),
    ArrowRight: () => turn(0.1, 0, 1),
    ArrowUp: () => turn(0, 0.1, 1),
    ArrowDown: () => turn(0, -0.1, 1),
    "+": () => turn(0, 0, 1 / 1.15),
    "=": () => turn(0, 0, 1 / 1.15),
    "-": () => turn(0, 0, 1.15),
    " ": () => play(!playing),
    ",": () => step(-1),
    ".": () => step(1),
  };
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !Object.hasOwn(keys, event.key)) return;
    event.preventDefault();
    keys[event.key]();
  });
  controls.addEventListener("change", draw);
  byId("play").addEventListener("click", () => play(!playing));
  byId("time").addEventListener("input", () => {
    play(false);
    show(Number(byId("time").value));
  });
  byId("speed").addEventListener("change", () => play(playing));
  byId("reset").addEventListener("click", () => {
    aim();
    draw();
  });
  byId("scene").addEventListener("change", () => {
    open(Number(byId("scene").value));
    aim();
    show(0);
    play(playing);
  });
  dark.addEventListener("change", () => {
    open(Number(byId("scene").value));
    show(frame);
  });

  open(Number(byId("scene").value));
  aim();
  show(0);
  new ResizeObserver(fit).observe(canvas);
  // Playback starts when the view is first visible, and never if reduced motion is preferred.
  const seen = new IntersectionObserver(([entry]) => {
    if (!entry.isIntersecting) return;
    seen.disconnect();
    if (!still.matches) play(true);
  }, { threshold: 0.3 });
  seen.observe(canvas);
})();
