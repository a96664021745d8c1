// The page: elements, time, and input of the user.
import uplotStyle from "uplot/dist/uPlot.min.css";
import { arrive, flights, last } from "./flight.js";
import { caseColor, onTheme } from "./look.js";
import pageStyle from "./page.css";
import { build as buildPlots } from "./plots.js";
import { build as buildScene } from "./scene.js";

const STEP = 1 / 30; // s, step of an arrow key
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

const make = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

document.head.append(make("style", { textContent: uplotStyle + pageStyle }));
const written = flights(document.getElementById("flights").textContent);
const { cases, arrows } = written;
const whole = Math.max(...cases.map(({ t }) => t[t.length - 1])); // s, also of a running simulation
const end = () => Math.max(...cases.map(last));
let running = Boolean(written.live);
const state = { t: 0, p: null, case: 0, playing: false, speed: 1, follow: false, ghosts: true };

// Elements -----------------------------------------------------------------------------------------------------------

const stage = make("div", { id: "stage" });
const plotted = make("div", { id: "plots" });
const play = make("button", { id: "play", title: "play or pause (space)" });
const follow = make("button", { id: "follow", textContent: "follow", title: "camera follows the payload (f)" });
const slider = make("input", { id: "time", type: "range", min: 0, max: whole, step: "any", value: 0, title: "time" });
const clock = make("output", { id: "clock" });
const mode = make("output", { id: "mode" });
const speed = make("select", { id: "speed", title: "speed" });
speed.append(...SPEEDS.map((each) => make("option", { value: each, textContent: `${each}×`, selected: each === 1 })));
const ghosts = make("input", { id: "ghosts", type: "checkbox", checked: true });
const chips = cases.map(({ name, label }, k) =>
  make("button", { className: "chip", title: label, onclick: () => choose(k) }, make("b", { textContent: name }), make("span", { textContent: label })),
);
const swatches = Object.entries(arrows).map(([kind, { label, N_per_m: scale }]) => {
  const box = make("input", { type: "checkbox", checked: true, onchange: () => (scene?.show(kind, box.checked), requestFrame()) });
  return make("label", { className: kind }, box, make("i"), make("span", { textContent: label }), make("em", { textContent: `${scale} N per m` }));
});
const ground = make("p");
const legend = make(
  "details",
  { id: "legend", open: innerWidth > 1100 },
  make("summary", { textContent: "legend" }),
  ...swatches,
  make("p", {}, make("i", { className: "line reference" }), "reference path"),
  make("p", {}, make("i", { className: "line wanted" }), "present reference pose"),
  make("p", {}, make("i", { className: "line flown" }), "simulated path"),
  ground,
);
const others = cases.length > 1 ? [make("label", { id: "others" }, ghosts, "other cases transparent")] : [];
document.body.append(
  make(
    "header",
    {},
    make("h1", { textContent: written.scenario }),
    make("small", { textContent: `seed ${written.seed}, colift ${written.version}` }),
    make("nav", {}, ...chips, ...others),
  ),
  make("main", {}, make("div", { id: "left" }, stage, make("div", { id: "bar" }, play, slider, clock, speed, follow), mode), plotted),
  make("footer", {}, "space: play or pause   ← →: step   f: follow   drag: rotate   wheel: zoom   click in a plot: set the time"),
);
stage.append(legend);

// Time ----------------------------------------------------------------------------------------------------------------

let requested = false;
let before = null; // ms, time of the previous frame while playing

/** Requests a frame; several requests result in one. */
function requestFrame() {
  if (!requested) requestAnimationFrame(frame);
  requested = true;
}

function frame(at) {
  requested = false;
  if (state.playing) {
    if (before !== null) seek(state.t + (state.speed * (at - before)) / 1000);
    before = at;
    if (state.t < end()) requestFrame();
    else if (running) before = null; // wait for more frames
    else run(false);
  }
  scene?.draw();
}

const within = (t, spans) => spans.some(([from, to]) => t >= from && t <= to);

/** Returns the status of the selected case as text. */
function status() {
  const { stopped, marks } = cases[state.case];
  const until = last(cases[state.case]);
  if (stopped && state.t >= until) return `stopped at ${until.toFixed(2)} s: ${stopped}`;
  const made = marks.updates.filter((each) => each <= state.t).length;
  const words = [];
  if (marks.updates.length) {
    words.push(state.t < (marks.learning_end ?? Infinity) ? "learning" : "learning ended", `${made} of ${marks.updates.length} updates`);
  } else words.push("no learned model");
  if (within(state.t, marks.internal)) words.push("internal forces active");
  for (const [name, spans] of Object.entries(marks.at_limit)) {
    if (within(state.t, spans)) words.push(`${name} at thrust limit`);
  }
  return words.join(", ");
}

/** Shows the flights at a time, s. */
function seek(t) {
  state.t = Math.min(Math.max(t, 0), end());
  state.p = scene ? scene.pose(state.t) : null;
  plots.move(state.t);
  slider.value = state.t;
  clock.textContent = `${state.t.toFixed(2)} s`;
  mode.textContent = `${cases[state.case].name}: ${status()}`;
  requestFrame();
}

function run(on) {
  state.playing = on;
  before = null;
  if (on && state.t >= end() && !running) seek(0);
  play.textContent = on ? "pause" : "play";
  requestFrame();
}

function choose(k) {
  state.case = k;
  chips.forEach((chip, n) => chip.setAttribute("aria-pressed", n === k));
  document.documentElement.style.setProperty("--case", caseColor(cases[k].name));
  scene?.choose(k, state.ghosts);
  plots.show(k, state.ghosts);
  seek(state.t);
}

function track(on) {
  state.follow = on;
  follow.setAttribute("aria-pressed", on);
  scene?.follow(on);
  requestFrame();
}

// Input of the user ---------------------------------------------------------------------------------------------------

play.onclick = () => run(!state.playing);
follow.onclick = () => track(!state.follow);
slider.oninput = () => seek(Number(slider.value));
speed.onchange = () => (state.speed = Number(speed.value));
ghosts.onchange = () => {
  state.ghosts = ghosts.checked;
  choose(state.case);
};
addEventListener("pointerup", ({ target }) => target.closest("button")?.blur()); // afterwards the space key plays, not the button
addEventListener("keydown", (event) => {
  const { key, target, ctrlKey, metaKey, altKey } = event;
  if (ctrlKey || metaKey || altKey || target.matches("select")) return;
  if (key === " " && target.matches("button, summary, input[type=checkbox]")) return;
  const does = {
    " ": () => run(!state.playing),
    f: () => track(!state.follow),
    ArrowLeft: () => (run(false), seek(state.t - STEP)),
    ArrowRight: () => (run(false), seek(state.t + STEP)),
  }[key];
  if (does) {
    event.preventDefault();
    does();
  }
});

// Start ---------------------------------------------------------------------------------------------------------------

let scene = null;
try {
  scene = buildScene(stage, written, requestFrame);
  ground.textContent = `grid: ${scene.step} m, at z = ${written.ground_m} m`;
} catch (error) {
  stage.prepend(make("p", { id: "blind", textContent: `the 3D view is not available: ${error.message}` }));
}
const plots = buildPlots(plotted, written, seek);
const tint = () => chips.forEach((chip, k) => chip.style.setProperty("--own", caseColor(cases[k].name)));
tint();
const learned = cases.findIndex(({ name }) => name === "C3");
choose(learned < 0 ? cases.length - 1 : learned);
run(false);
track(Boolean(scene?.far));
onTheme(() => {
  tint();
  choose(state.case);
});
new ResizeObserver(() => {
  scene?.size();
  plots.size();
  requestFrame();
}).observe(document.body);

// Running simulation -----------------------------------------------------------------------------------------------------

if (running) {
  const source = new EventSource(written.live);
  const ended = () => {
    source.close();
    running = false;
  };
  source.onmessage = ({ data }) => {
    arrive(cases[0], JSON.parse(data));
    scene?.arrived();
    choose(0);
  };
  source.addEventListener("end", ended);
  source.onerror = ended; // received frames remain
  run(true);
}

window.seek = seek;
window.state = () => ({ ...state, case: cases[state.case].name, end: end(), running });
