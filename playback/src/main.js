// The page: elements, time, and input of the user.
import uplotStyle from "uplot/dist/uPlot.min.css";
import { arrive, flights, last } from "./flight.js";
import { caseColor, ink, onTheme } from "./look.js";
import pageStyle from "./page.css";
import { build as buildPlots } from "./plots.js";
import { build as buildScene } from "./scene.js";

const STEP = 1 / 30; // s, step of an arrow key
const LONG_STEP = 1; // s, step of an arrow key with shift
const QUIET = 300; // ms without changes after which the address is updated
const KEYS = [
  ["space", "play or pause"],
  ["← →", "step of one frame; with shift: 1 s"],
  ["Home, End", "start or end of the flight"],
  ["1 to 9", "select a case"],
  ["shift + 1 to 9", "go to 10 % to 90 % of the flight"],
  ["f", "the camera follows the payload, or shows the whole path"],
  ["l", "copy a link to case, time and signals"],
  ["s", "save a picture of scene and plots as PNG"],
  ["?", "this list"],
  ["drag, wheel", "rotate, zoom"],
  ["click in a plot", "set the time"],
];
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
const link = make("button", { textContent: "copy link", title: "link to case, time and signals (l)" });
const save = make("button", { textContent: "save PNG", title: "picture of scene and plots (s)" });
const keys = make("button", { textContent: "keys", title: "list of the keys (?)" });
const note = make("output", { id: "note" });
const rows = KEYS.map(([key, meaning]) => make("tr", {}, make("th", { textContent: key }), make("td", { textContent: meaning })));
const close = make("button", { textContent: "close" });
const help = make("dialog", { id: "help" }, make("h2", { textContent: "Keys and pointer" }), make("table", {}, ...rows), close);
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
  make("footer", {}, make("span", { textContent: "space: play or pause   ← →: step   1 to 9: case   ?: all keys" }), note, link, save, keys),
  help,
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

// Address: case, time and signals ---------------------------------------------------------------------------------------

let fragmentTimer = 0;

/** Returns the fragment of the address that restores case, time and signals. */
const fragment = () => `#case=${encodeURIComponent(cases[state.case].name)}&t=${state.t.toFixed(2)}&signals=${plots.text()}`;

/** Writes case, time and signals to the address after a short time without changes. */
function remember() {
  clearTimeout(fragmentTimer);
  if (!state.playing) fragmentTimer = setTimeout(writeFragment, QUIET);
}

function writeFragment() {
  try {
    history.replaceState(null, "", fragment());
  } catch {
    // the page is a part of another one and has no address
  }
}

/** Shows what the fragment of the address states; unknown names and numbers are ignored. */
function restore() {
  const wanted = new URLSearchParams(location.hash.slice(1));
  const k = cases.findIndex(({ name }) => name === wanted.get("case"));
  const t = Number.parseFloat(wanted.get("t"));
  if (wanted.has("signals")) plots.read(wanted.get("signals"));
  if (k >= 0) choose(k);
  if (Number.isFinite(t)) {
    run(false);
    seek(t);
  }
}

/** Shows a short message in the footer. */
function announce(text) {
  note.textContent = text;
  setTimeout(() => note.textContent === text && (note.textContent = ""), 4000);
}

async function copyLink() {
  writeFragment();
  try {
    await navigator.clipboard.writeText(location.href);
    announce("link copied");
  } catch {
    announce("the link is in the address bar");
  }
}

// Picture --------------------------------------------------------------------------------------------------------------

/** Returns a canvas with the scene at the left and the plots with their legends at the right. */
function picture() {
  const ratio = Math.min(devicePixelRatio, 2);
  const images = plots.pictures();
  const [width, side] = [stage.clientWidth, images.length ? 440 : 0];
  const rows = images.map(({ canvas, entries }) => canvas.height / devicePixelRatio + 24 + 16 * Math.ceil(entries.length / 2));
  const height = Math.max(stage.clientHeight + 60, rows.reduce((sum, each) => sum + each, 20));
  const canvas = make("canvas", { width: (width + side) * ratio, height: height * ratio });
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.fillStyle = ink("paper");
  pen.fillRect(0, 0, width + side, height);
  pen.fillStyle = ink("ground");
  pen.fillRect(0, 44, width, height - 60);
  const font = "system-ui, sans-serif";
  const write = (text, x, y, style = "12px") => {
    pen.fillStyle = ink("text");
    pen.font = `${style} ${font}`;
    pen.fillText(text, x, y);
  };
  write(`${written.scenario}: ${cases[state.case].name}, ${cases[state.case].label}`, 12, 20, "bold 14px");
  write(`${state.t.toFixed(2)} s, ${status()}; seed ${written.seed}, colift ${written.version}`, 12, 37);
  if (scene) {
    scene.draw();
    pen.drawImage(scene.canvas, 0, 44, width, stage.clientHeight);
    pen.textAlign = "center";
    for (const { text, x, y } of scene.labels()) write(text, x, y + 48);
    pen.textAlign = "left";
  }
  let y = 20;
  images.forEach(({ heading, canvas: plot, entries }, n) => {
    write(heading, width + 68, y, "bold 12.5px");
    const [w, h] = [plot.width / devicePixelRatio, plot.height / devicePixelRatio];
    pen.drawImage(plot, width, y + 4, side, (h * side) / w);
    entries.forEach(({ text, color }, k) => {
      const [x, line] = [width + 68 + 182 * (k % 2), y + h + 18 + 16 * Math.floor(k / 2)];
      pen.fillStyle = color;
      pen.fillRect(x, line - 5, 14, 3);
      write(text, x + 19, line, "11px");
    });
    y += rows[n];
  });
  return canvas;
}

function savePicture() {
  picture().toBlob((blob) => {
    const address = URL.createObjectURL(blob);
    make("a", { href: address, download: `${written.scenario}-${cases[state.case].name}-${state.t.toFixed(2)}s.png` }).click();
    setTimeout(() => URL.revokeObjectURL(address), 1000);
    announce("picture saved");
  });
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
  for (const { text, span } of marks.faults) if (within(state.t, [span])) words.push(`fault: ${text}`);
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
  remember();
  requestFrame();
}

function run(on) {
  state.playing = on;
  before = null;
  if (on && state.t >= end() && !running) seek(0);
  play.textContent = on ? "pause" : "play";
  remember();
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

link.onclick = copyLink;
save.onclick = savePicture;
keys.onclick = () => help.showModal();
close.onclick = () => help.close();
play.onclick = () => run(!state.playing);
follow.onclick = () => track(!state.follow);
slider.oninput = () => seek(Number(slider.value));
speed.onchange = () => (state.speed = Number(speed.value));
ghosts.onchange = () => {
  state.ghosts = ghosts.checked;
  choose(state.case);
};
addEventListener("pointerup", ({ target }) => target.closest("button")?.blur()); // afterwards the space key plays, not the button
/** Returns the tenth of the flight of a digit key with shift; null for other keys. */
const tenth = ({ code, shiftKey }) => (shiftKey && /^Digit[1-9]$/.test(code) ? Number(code.slice(5)) / 10 : null);

addEventListener("keydown", (event) => {
  const { key, target, shiftKey, ctrlKey, metaKey, altKey } = event;
  if (ctrlKey || metaKey || altKey || help.open || target.matches("select")) return;
  if (key === " " && target.matches("button, summary, input[type=checkbox]")) return;
  const go = (t) => (run(false), seek(t));
  const step = shiftKey ? LONG_STEP : STEP;
  let does = {
    " ": () => run(!state.playing),
    f: () => track(!state.follow),
    l: copyLink,
    s: savePicture,
    "?": () => help.showModal(),
    Home: () => go(0),
    End: () => go(end()),
    ArrowLeft: () => go(state.t - step),
    ArrowRight: () => go(state.t + step),
  }[key];
  if (/^[1-9]$/.test(key) && Number(key) <= cases.length) does = () => choose(Number(key) - 1);
  else if (tenth(event) !== null) does = () => go(tenth(event) * end());
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
const plots = buildPlots(plotted, written, seek, () => remember());
const tint = () => chips.forEach((chip, k) => chip.style.setProperty("--own", caseColor(cases[k].name)));
tint();
const learned = cases.findIndex(({ name }) => name === "C3");
choose(learned < 0 ? cases.length - 1 : learned);
run(false);
track(Boolean(scene?.far));
restore();
addEventListener("hashchange", restore);
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
window.picture = () => picture().toDataURL();
window.state = () => ({ ...state, case: cases[state.case].name, end: end(), running });
