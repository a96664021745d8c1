// The scene: teams, reference, paths and arrows in the world frame, z up, metres.
import {
  AmbientLight,
  Box3,
  BoxGeometry,
  BufferAttribute,
  BufferGeometry,
  Color,
  ConeGeometry,
  CylinderGeometry,
  DirectionalLight,
  EdgesGeometry,
  Group,
  Line,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  PerspectiveCamera,
  Quaternion,
  Scene,
  SphereGeometry,
  TorusGeometry,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { moment, number, rotation, vector } from "./flight.js";
import { caseColor, ink } from "./look.js";

const GHOST = 0.2; // opacity of a case that is not chosen
const UP = new Vector3(0, 1, 0); // along which three.js builds cylinders and cones
const ROD = new CylinderGeometry(1, 1, 1, 12);
const BALL = new SphereGeometry(1, 16, 12);
const HEAD = new ConeGeometry(1, 1, 16).translate(0, -0.5, 0);
const a = new Vector3();
const b = new Vector3();
const spare = new Quaternion();

/** Lays a rod between two points. */
function lay(rod, from, to, thickness) {
  b.subVectors(to, from);
  const length = b.length();
  rod.position.addVectors(from, to).multiplyScalar(0.5);
  rod.scale.set(thickness, Math.max(length, 1e-6), thickness);
  if (length > 1e-6) rod.quaternion.setFromUnitVectors(UP, b.divideScalar(length));
}

/** An arrow whose length is a force over `perMetre`, N per m. */
function arrow(thickness, perMetre, paint) {
  const shaft = new Mesh(ROD, paint);
  const head = new Mesh(HEAD, paint);
  const group = new Group().add(shaft, head);
  const foot = new Vector3();
  const neck = new Vector3();
  const tip = new Vector3();
  return {
    group,
    point(from, force) {
      const length = force.length() / perMetre;
      group.visible = length > 1e-4;
      if (!group.visible) return;
      const long = Math.min(7 * thickness, length);
      foot.copy(from);
      tip.copy(force).divideScalar(perMetre).add(from);
      neck.subVectors(tip, foot).multiplyScalar((length - long) / length).add(foot);
      lay(shaft, foot, neck, thickness);
      shaft.visible = length > long;
      head.position.copy(tip);
      head.scale.set(long * 0.4, long, long * 0.4);
      head.quaternion.setFromUnitVectors(UP, a.copy(force).normalize());
    },
  };
}

/** The bodies of one case: its payload, agents with rotors, arms. `ghost` makes them translucent. */
function team(shape, flight) {
  const group = new Group();
  const thick = 0.014 * shape.size_m;
  const paints = { load: new MeshStandardMaterial(), frame: new MeshStandardMaterial(), arm: new MeshStandardMaterial() };
  for (const paint of Object.values(paints)) {
    paint.roughness = 0.65;
    paint.metalness = 0.05;
  }
  const load = new Group();
  const box = new Mesh(new BoxGeometry(...shape.payload.half_m.map((half) => 2 * half)), paints.load);
  const [w, x, y, z] = shape.payload.axes_wxyz;
  box.quaternion.set(x, y, z, w);
  load.add(box);
  for (const contact of shape.contacts) {
    const held = new Vector3(...contact.at_m);
    const near = new Vector3(...contact.on_box_m);
    if (held.distanceTo(near) > 1e-3) {
      const strut = new Mesh(ROD, paints.load);
      lay(strut, near, held, thick);
      load.add(strut);
    }
  }
  group.add(load);

  const bases = shape.agents.map((agent) => {
    const base = new Group();
    const hub = new Mesh(new BoxGeometry(1, 1, 1), paints.frame);
    hub.scale.set(0.5 * agent.span_m, 0.5 * agent.span_m, 0.3 * agent.span_m);
    base.add(hub);
    const middle = new Vector3();
    for (const rotor of agent.rotors_m) {
      const at = new Vector3(...rotor);
      const boom = new Mesh(ROD, paints.frame);
      lay(boom, middle, at, 0.7 * thick);
      const ring = new Mesh(new TorusGeometry(agent.rotor_radius_m, 0.4 * thick, 8, 32), paints.frame);
      ring.position.copy(at);
      const blade = new Mesh(new BoxGeometry(1.9 * agent.rotor_radius_m, 1.2 * thick, 0.4 * thick), paints.arm);
      blade.position.copy(at);
      blade.rotation.z = Math.atan2(at.y, at.x) + 0.6;
      base.add(boom, ring, blade);
    }
    group.add(base);
    return base;
  });
  const rods = shape.links.map(() => new Mesh(ROD, paints.arm));
  const balls = shape.nodes.map((kind) => {
    const ball = new Mesh(BALL, kind === "tip" ? paints.load : paints.arm);
    ball.scale.setScalar((kind === "base" ? 0 : 1.5) * thick);
    return ball;
  });
  group.add(...rods, ...balls);
  const nodes = shape.nodes.map(() => new Vector3());

  return {
    group,
    load,
    bases,
    nodes,
    pose(now) {
      const { p, q, base, base_q, nodes: track } = flight.tracks;
      vector(p, now, 0, load.position);
      rotation(q, now, 0, load.quaternion, spare);
      bases.forEach((each, j) => {
        vector(base, now, 3 * j, each.position);
        rotation(base_q, now, 4 * j, each.quaternion, spare);
      });
      nodes.forEach((node, k) => balls[k].position.copy(vector(track, now, 3 * k, node)));
      shape.links.forEach(([from, to], k) => lay(rods[k], nodes[from], nodes[to], thick));
    },
    paint(ghost) {
      const color = caseColor(flight.name);
      paints.load.color.set(color);
      paints.frame.color.set(ghost ? color : ink("frame"));
      paints.arm.color.set(ghost ? color : ink("arm"));
      for (const paint of Object.values(paints)) {
        paint.transparent = ghost;
        paint.opacity = ghost ? GHOST : 1;
        paint.depthWrite = !ghost;
        paint.needsUpdate = true;
      }
    },
  };
}

/** A line through the columns of a track. */
function path(track, paint) {
  const line = new Line(new BufferGeometry(), paint);
  line.geometry.setAttribute("position", new BufferAttribute(track.values, 3));
  line.frustumCulled = false; // what of it is drawn changes
  return line;
}

/** Lines of a grid on the ground about a point, `step` apart. */
function grid(center, half, step, height, paint) {
  const [x0, y0] = [center.x, center.y].map((each) => Math.round(each / step) * step);
  const n = Math.ceil(half / step);
  const ends = [];
  for (let k = -n; k <= n; k += 1) {
    ends.push(x0 + k * step, y0 - n * step, height, x0 + k * step, y0 + n * step, height);
    ends.push(x0 - n * step, y0 + k * step, height, x0 + n * step, y0 + k * step, height);
  }
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
  return new LineSegments(geometry, paint);
}

/** The scene in an element; throws where the browser has no WebGL. `changed` is called when the reader moves it. */
export function build(element, { shape, cases, arrows, ground_m }, changed) {
  const renderer = new WebGLRenderer({ antialias: true });
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  element.prepend(renderer.domElement);
  const scene = new Scene();
  scene.background = new Color();
  const sun = new DirectionalLight(0xffffff, 2.2);
  sun.position.set(2, -3, 6);
  scene.add(new AmbientLight(0xffffff, 1.4), sun);
  const camera = new PerspectiveCamera(35, 1, 0.01 * shape.size_m, 1000 * shape.size_m);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, renderer.domElement);
  controls.addEventListener("change", changed);

  const teams = cases.map((flight) => team(shape, flight));
  scene.add(...teams.map(({ group }) => group));
  const paints = Object.fromEntries(Object.keys(arrows).map((kind) => [kind, new MeshBasicMaterial()]));
  const grow = (kind) => arrow(0.011 * shape.size_m, arrows[kind].N_per_m, paints[kind]);
  const forces = {
    thrust: shape.agents.map(() => grow("thrust")),
    contact: shape.contacts.map(() => grow("contact")),
    disturbance: [grow("disturbance")],
  };
  const shown = Object.fromEntries(
    Object.entries(forces).map(([kind, all]) => [kind, new Group().add(...all.map(({ group }) => group))]),
  );
  scene.add(...Object.values(shown));

  const lines = Object.fromEntries(["reference", "grid", "drop"].map((name) => [name, new LineBasicMaterial()]));
  const reference = path(cases[0].tracks.p_d, lines.reference);
  const wanted = new LineSegments(
    new EdgesGeometry(new BoxGeometry(...shape.payload.half_m.map((half) => 2 * half))),
    lines.reference,
  );
  const [w, x, y, z] = shape.payload.axes_wxyz;
  wanted.quaternion.set(x, y, z, w);
  const desired = new Group().add(wanted);
  const flown = cases.map((flight) => path(flight.tracks.p, new LineBasicMaterial()));
  const drop = path({ values: new Float32Array(6) }, lines.drop);
  scene.add(reference, desired, ...flown, drop);

  const around = new Box3();
  for (const { tracks } of cases) {
    for (const { values } of [tracks.p, tracks.p_d, tracks.base]) {
      for (let k = 0; k < values.length; k += 3) around.expandByPoint(a.set(values[k], values[k + 1], values[k + 2]));
    }
  }
  const center = around.getCenter(new Vector3());
  const radius = around.getSize(a).length() / 2 + 0.35 * shape.size_m;
  const step = 10 ** Math.round(Math.log10(radius / 3));
  scene.add(grid(center, 2.2 * radius, step, ground_m, lines.grid));
  const triad = ["x", "y", "z"].map((_, k) => {
    const each = arrow(0.009 * shape.size_m, 1, new MeshBasicMaterial({ color: ["#cc3311", "#228833", "#4477cc"][k] }));
    each.point(a.set(0, 0, ground_m), b.clone().set(k === 0, k === 1, k === 2).multiplyScalar(0.5 * step));
    return each.group;
  });
  scene.add(...triad);

  const labels = [
    ...["x", "y", "z"].map((text, k) => ({ text, at: new Vector3().setComponent(k, 0.58 * step) })),
    ...shape.agents.map(({ name }) => ({ text: name, at: new Vector3() })),
  ];
  for (const each of labels.slice(0, 3)) each.at.z += ground_m;
  for (const each of labels) {
    each.element = Object.assign(document.createElement("span"), { className: "label", textContent: each.text });
    element.append(each.element);
  }

  let chosen = 0;
  let ghosts = true;
  let follows = false;
  const last = new Vector3();

  function size() {
    const { clientWidth, clientHeight } = element;
    renderer.setSize(clientWidth, clientHeight);
    camera.aspect = clientWidth / Math.max(clientHeight, 1);
    camera.updateProjectionMatrix();
  }

  function fit(around, radius) {
    const half = ((camera.fov / 2) * Math.PI) / 180;
    const narrow = Math.min(half, Math.atan(Math.tan(half) * camera.aspect));
    controls.target.copy(around);
    camera.position.set(0.75, -1.5, 0.62).normalize().multiplyScalar(radius / Math.sin(narrow)).add(around);
    controls.update();
  }

  function place(text, at) {
    a.copy(at).project(camera);
    text.hidden = a.z > 1;
    const left = ((a.x + 1) / 2) * element.clientWidth;
    const top = ((1 - a.y) / 2) * element.clientHeight;
    text.style.transform = `translate(${left.toFixed(1)}px, ${top.toFixed(1)}px) translate(-50%, -50%)`;
  }

  size();
  fit(center, radius);
  return {
    size,
    far: radius > 4 * shape.size_m,
    show(kind, visible) {
      shown[kind].visible = visible;
    },
    paint() {
      scene.background.set(ink("ground"));
      for (const [kind, paint] of Object.entries(paints)) paint.color.set(ink(kind));
      for (const [name, paint] of Object.entries(lines)) paint.color.set(ink(name));
      teams.forEach((each, k) => each.paint(k !== chosen));
      flown.forEach((line, k) => line.material.color.set(caseColor(cases[k].name)));
    },
    choose(k, others) {
      chosen = k;
      ghosts = others;
      this.paint();
    },
    follow(on) {
      follows = on;
      if (on) {
        const from = controls.target.clone();
        fit(teams[chosen].load.position, 1.5 * shape.size_m);
        last.copy(teams[chosen].load.position);
        camera.position.sub(controls.target);
        camera.position.add(controls.target);
        from.copy(controls.target);
      } else fit(center, radius);
    },
    /** Everything as it is at a time; returns where the payload of the chosen case is shown, m. */
    pose(t) {
      teams.forEach((each, k) => {
        each.group.visible = k === chosen || ghosts;
        each.pose(moment(cases[k].t, t));
      });
      const { tracks, t: times } = cases[chosen];
      const now = moment(times, t);
      const { load, bases, nodes } = teams[chosen];
      vector(tracks.p_d, now, 0, desired.position);
      rotation(tracks.q_d, now, 0, desired.quaternion, spare);
      bases.forEach((base, j) => {
        const force = new Vector3(0, 0, number(tracks.u, now, j)).applyQuaternion(base.quaternion);
        forces.thrust[j].point(base.position, force);
        labels[3 + j].at.set(0, 0, 0.16 * shape.size_m).applyQuaternion(base.quaternion).add(base.position);
      });
      shape.contacts.forEach(({ node }, k) => {
        forces.contact[k].point(nodes[node], vector(tracks.lam, now, 3 * k, new Vector3()));
      });
      forces.disturbance[0].point(load.position, vector(tracks.disturbance, now, 0, new Vector3()));
      flown.forEach((line, k) => {
        line.visible = k === chosen;
        line.geometry.setDrawRange(0, now.i + 1);
      });
      const ends = drop.geometry.getAttribute("position");
      ends.setXYZ(0, load.position.x, load.position.y, load.position.z);
      ends.setXYZ(1, load.position.x, load.position.y, ground_m);
      ends.needsUpdate = true;
      if (follows) {
        a.subVectors(load.position, last);
        camera.position.add(a);
        controls.target.add(a);
        last.copy(load.position);
      }
      return load.position.toArray();
    },
    draw() {
      controls.update();
      renderer.render(scene, camera);
      for (const { element: text, at } of labels) place(text, at);
    },
    step,
  };
}
