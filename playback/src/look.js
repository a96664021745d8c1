// Colours: on a light background those of the figures (colift/visualization/style.py), on a dark one lighter variants
// (colour schemes of Paul Tol).

const CASES = {
  C1: ["#ddaa33", "#eecc66"],
  C2: ["#bb5566", "#ee99aa"],
  C3: ["#004488", "#6699cc"],
  adaptive: ["#000000", "#ffffff"],
  integral: ["#117733", "#44aa77"],
  disturbance_observer: ["#33bbee", "#88ccee"],
  parametric: ["#aa4499", "#dd88cc"],
  true_residual: ["#777777", "#aaaaaa"],
  label_feedback: ["#ee7733", "#ffaa77"],
  regression: ["#44aa99", "#77ccbb"],
  gp_label_feedback: ["#882255", "#cc6699"],
};
const AGENTS = [
  ["#7755aa", "#aa88dd"],
  ["#997700", "#cccc66"],
  ["#774411", "#cc9966"],
  ["#5588aa", "#88bbdd"],
  ["#aa7799", "#ddaacc"],
  ["#555555", "#bbbbbb"],
];
const dark = matchMedia("(prefers-color-scheme: dark)");
const shade = () => (dark.matches ? 1 : 0);

/** Calls a function when the colour scheme changes between light and dark. */
export const onTheme = (changed) => dark.addEventListener("change", changed);

/** Returns the colour of a case. */
export const caseColor = (name) => (CASES[name] ?? CASES.true_residual)[shade()];

/** Returns the colour of the k-th agent's curves. */
export const agentColor = (k) => AGENTS[k % AGENTS.length][shade()];

/** Returns a colour of the style sheet. */
export const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
