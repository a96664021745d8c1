// Colours: those of the figures (colift/look.py) on light ground, their lighter sisters on dark (Paul Tol's schemes).

const CASES = {
  C1: ["#ddaa33", "#eecc66"],
  C2: ["#bb5566", "#ee99aa"],
  C3: ["#004488", "#6699cc"],
  C4: ["#000000", "#ffffff"],
  I: ["#117733", "#44aa77"],
  DOB: ["#33bbee", "#88ccee"],
  P: ["#aa4499", "#dd88cc"],
  O: ["#777777", "#aaaaaa"],
  F: ["#ee7733", "#ffaa77"],
  R: ["#44aa99", "#77ccbb"],
  H: ["#882255", "#cc6699"],
};
const AGENTS = [
  ["#228833", "#66cc77"],
  ["#aa3377", "#ee88cc"],
  ["#997700", "#cccc66"],
  ["#0099bb", "#88ddee"],
  ["#774411", "#cc9966"],
  ["#555555", "#bbbbbb"],
];
const dark = matchMedia("(prefers-color-scheme: dark)");
const shade = () => (dark.matches ? 1 : 0);

/** Calls back when the reader changes between light and dark. */
export const onTheme = (changed) => dark.addEventListener("change", changed);

/** The colour of a case. */
export const caseColor = (name) => (CASES[name] ?? CASES.O)[shade()];

/** The colour of the k-th agent's curves. */
export const agentColor = (k) => AGENTS[k % AGENTS.length][shade()];

/** A colour that the style sheet names. */
export const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
