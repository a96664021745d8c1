// 3D scene: teams, reference, paths and arrows in the world frame, z up, metres.
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
  LineDashedMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  PerspectiveCamera,
  Quaternion,
  Scene,
  Sphere,
  SphereGeometry,
  TorusGeometry,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { moment, number, rotation, vector } from "./flight.js";
import { agentColor, caseColor, ink } from "./look.js";

const CLOSE = 2; // team sizes, edge of the box around the payload in the view of a following camera
const MARGIN = 0.92; // filled fraction of the window
const GHOST = 0.2; // opacity of a case that is not selected
const UP = new Vector3(0, 1, 0); // axis of cylinders and cones in three.js
const ROD = new CylinderGeometry(1, 1, 1, 12);
const BALL = new SphereGeometry(1, 16, 12);
const HEAD = new ConeGeometry(1, 1, 16).translate(0, -0.5, 0);
const a = new Vector3();
const b = new Vector3();
const spare = new Quaternion();

/** Places a rod between two points. */
function lay(rod, from, to, thickness) {
  b.subVectors(to, from);
  const length = b.length();
  rod.position.addVectors(from, to).multiplyScalar(0.5);
  rod.scale.set(thickness, Math.max(length, 1e-6), thickness);
  if (length > 1e-6) rod.quaternion.setFromUnitVectors(UP, b.divideScalar(length));
}

/** Returns an arrow whose length is a force over `perMetre`, N per m. */
function arrow(thickness, perMetre, paint) {
  const shaft = new Mesh(ROD, paint);
  const head = new Mesh(HEAD, paint);
  shaft.renderOrder = head.renderOrder = 1;
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

/** Returns the bodies of one case: payload, agents with rotors, arms. */
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

  const hubs = shape.agents.map(() => new MeshStandardMaterial({ roughness: 0.65 }));
  const bases = shape.agents.map((agent, j) => {
    const base = new Group();
    const hub = new Mesh(new BoxGeometry(1, 1, 1), hubs[j]);
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
    /** Reduces the opacity of a case near the selected case, so that it does not cover it. */
    fade(distance) {
      const opacity = GHOST * Math.min(1, distance / (0.1 * shape.size_m));
      for (const paint of [...Object.values(paints), ...hubs]) paint.opacity = opacity;
      group.visible = opacity > 0.01;
    },
    paint(ghost) {
      const color = caseColor(flight.name);
      paints.load.color.set(color);
      paints.frame.color.set(ghost ? color : ink("frame"));
      paints.arm.color.set(ghost ? color : ink("arm"));
      hubs.forEach((hub, j) => hub.color.set(ghost ? color : agentColor(j)));
      for (const paint of [...Object.values(paints), ...hubs]) {
        paint.transparent = ghost;
        paint.opacity = 1;
        paint.depthWrite = !ghost;
        paint.needsUpdate = true;
      }
    },
  };
}

/** Returns a line through the points of a track. */
function path(track, paint) {
  const line = new Line(new BufferGeometry(), paint);
  line.geometry.setAttribute("position", new BufferAttribute(track.values, 3));
  line.frustumCulled = false; // the drawn part changes
  line.geometry.boundingSphere = new Sphere(); // frames that are not yet available would invalidate it
  return line;
}

/** Returns the lines of a ground grid around a point, `step` apart. */
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

/** Returns the corners of a box. */
function corners({ min, max }) {
  return [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => new Vector3(x, y, z))));
}

/** Builds the scene in an element; throws without WebGL. `changed` is called when the user moves the camera. */
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
  paints.disturbance.depthTest = false; // the arrow starts inside the payload
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

  const dashes = 0.04 * shape.size_m;
  const lines = {
    reference: new LineBasicMaterial(),
    wanted: new LineDashedMaterial({ dashSize: dashes, gapSize: 0.6 * dashes }),
    grid: new LineBasicMaterial(),
    drop: new LineBasicMaterial(),
  };
  const longest = cases.reduce((one, other) => (other.t.length > one.t.length ? other : one));
  const reference = path(longest.tracks.p_d, lines.reference);
  const wanted = new LineSegments(
    new EdgesGeometry(new BoxGeometry(...shape.payload.half_m.map((half) => 2 * half))),
    lines.wanted,
  );
  const [w, x, y, z] = shape.payload.axes_wxyz;
  wanted.quaternion.set(x, y, z, w);
  const desired = new Group().add(wanted.computeLineDistances());
  const flown = cases.map((flight) => path(flight.tracks.p, new LineBasicMaterial()));
  const drop = path({ values: new Float32Array(6) }, lines.drop);
  scene.add(reference, desired, ...flown, drop);

  const around = new Box3();
  for (const { tracks } of cases) {
    for (const { values } of [tracks.p, tracks.p_d, tracks.base]) {
      for (let k = 0; k < values.length; k += 3) {
        if (Number.isFinite(values[k])) around.expandByPoint(a.set(values[k], values[k + 1], values[k + 2]));
      }
    }
  }
  around.expandByScalar(0.3 * shape.size_m);
  const path_m = around.getSize(a).length();
  const center = around.getCenter(new Vector3());
  const whole = corners(around).concat(new Vector3(center.x, center.y, around.max.z + 0.3 * shape.size_m));
  const step = 10 ** Math.round(Math.log10(path_m / 6));
  scene.add(grid(center, 2.5 * path_m, step, ground_m, lines.grid));
  const origin = new Vector3(Math.round(center.x / step) * step, Math.round(center.y / step) * step, ground_m);
  const axes = [0, 1, 2].map((k) => new Vector3().setComponent(k, 0.5 * step));
  const triad = axes.map((along, k) => {
    const each = arrow(0.009 * shape.size_m, 1, new MeshBasicMaterial({ color: ["#cc3311", "#228833", "#4477cc"][k] }));
    each.point(origin, along);
    return each.group;
  });
  scene.add(...triad);
  const names = axes.map((along) => along.clone().multiplyScalar(1.16).add(origin));
  if (around.min.z - ground_m < path_m) {
    whole.push(new Vector3(center.x, center.y, ground_m), ...axes.map((along) => along.clone().multiplyScalar(1.4).add(origin)));
  }

  const labels = [
    ...["x", "y", "z"].map((text, k) => ({ text, at: names[k] })),
    ...shape.agents.map(({ name }) => ({ text: name, at: new Vector3() })),
  ];
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

  /** Places the camera so that all points fill the view and are centred. */
  function fit(points) {
    const back = new Vector3(0.75, -1.5, 0.62).normalize();
    const right = new Vector3().crossVectors(camera.up, back).normalize();
    const upward = new Vector3().crossVectors(back, right);
    const tall = MARGIN * Math.tan(((camera.fov / 2) * Math.PI) / 180);
    const middle = new Box3().setFromPoints(points).getCenter(controls.target);
    let away = 0;
    for (let round = 0; round < 8; round += 1) {
      const all = points.map((point) => a.copy(point).sub(middle) && [a.dot(right), a.dot(upward), a.dot(back)]);
      away = Math.max(...all.map(([x, y, z]) => z + Math.max(Math.abs(x) / camera.aspect, Math.abs(y)) / tall));
      for (const [n, along] of [right, upward].entries()) {
        const at = all.map((each) => each[n] / (away - each[2]));
        middle.addScaledVector(along, (0.5 * away * (Math.max(...at) + Math.min(...at))) / 1.2);
      }
    }
    camera.position.copy(back).multiplyScalar(away).add(middle);
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
  fit(whole);
  return {
    size,
    far: path_m > 12 * shape.size_m,
    show(kind, visible) {
      shown[kind].visible = visible;
    },
    paint() {
      scene.background.set(ink("ground"));
      for (const [kind, paint] of Object.entries(paints)) paint.color.set(ink(kind));
      for (const [name, paint] of Object.entries(lines)) paint.color.set(ink(name === "wanted" ? "reference" : name));
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
      last.copy(teams[chosen].load.position);
      fit(on ? corners(new Box3().setFromCenterAndSize(last, a.setScalar(CLOSE * shape.size_m))) : whole);
    },
    /** Shows all objects at a time; returns the position of the payload of the selected case, m. */
    pose(t) {
      teams.forEach((each, k) => each.pose(moment(cases[k], t)));
      teams.forEach((each, k) => {
        each.group.visible = k === chosen;
        if (k !== chosen && ghosts) each.fade(each.load.position.distanceTo(teams[chosen].load.position));
      });
      const { tracks } = cases[chosen];
      const now = moment(cases[chosen], t);
      const { load, bases, nodes } = teams[chosen];
      vector(tracks.p_d, now, 0, desired.position);
      rotation(tracks.q_d, now, 0, desired.quaternion, spare);
      bases.forEach((base, j) => {
        const force = new Vector3(0, 0, number(tracks.u, now, j)).applyQuaternion(base.quaternion);
        forces.thrust[j].point(base.position, force);
        labels[3 + j].at.copy(force).divideScalar(arrows.thrust.N_per_m).add(base.position);
        labels[3 + j].at.z += 0.08 * shape.size_m;
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
    canvas: renderer.domElement,
    /** Returns the visible labels with their positions in the element, px. */
    labels: () =>
      labels
        .filter(({ element: text }) => !text.hidden)
        .map(({ text, at }) => {
          a.copy(at).project(camera);
          return { text, x: ((a.x + 1) / 2) * element.clientWidth, y: ((1 - a.y) / 2) * element.clientHeight };
        }),
    /** Updates the paths after new frames have been received. */
    arrived() {
      for (const line of flown) line.geometry.getAttribute("position").needsUpdate = true;
    },
    step,
  };
}
