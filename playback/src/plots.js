// Plots of errors, contact forces and predictive standard deviations over time, with a common cursor.
import uPlot from "uplot";
import { column, norms } from "./flight.js";
import { agentColor, caseColor, ink } from "./look.js";

const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const GUTTER = 68; // px, left margin of all plots, so that their time axes are aligned
const HEIGHT = 132; // px, height of a plot without time axis in a scrolling page
const [MIN_HEIGHT, MAX_HEIGHT] = [84, 240]; // px, if the plots fill their column
const AXIS = 40; // px, height of the time axis of the last plot
const shorter = (value) => (value == null ? "–" : Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(3));

const BRIEF = 0.005; // fraction of the values that may lie below a logarithmic axis: zero crossings of a norm
const MAX_DECADES = 7; // of a logarithmic axis; smaller values are numerical zeros

/** Returns the range of a logarithmic axis as in the figures; powers of ten where it would contain fewer than two. */
function logarithmic(rows) {
  const values = rows.flat().filter((value) => value > 0).sort((one, other) => one - other);
  if (!values.length) return [0.1, 1];
  const top = values[values.length - 1];
  const low = Math.max(0.7 * values[Math.floor(BRIEF * values.length)], top * 10 ** -MAX_DECADES);
  const [from, to] = [Math.log10(low), Math.log10(1.3 * top)];
  return Math.floor(to) > Math.ceil(from) ? [10 ** from, 10 ** to] : [10 ** Math.floor(from), 10 ** Math.ceil(to)];
}

const powers = (_, at) => at.map((value) => (value === null ? "" : String(Number(value.toPrecision(3)))));

/** Returns the curves of one plot with label, colour, dashes, times and values; cases that are not selected are faint. */
function curves(kind, { shape, cases }, chosen, others) {
  const visible = cases.map((flight, k) => ({ flight, faint: k !== chosen })).filter(({ faint }) => others || !faint);
  const each = (name, tracks, k, dash, at = "t") =>
    visible.map(({ flight, faint }) => ({
      label: name || flight.name,
      listed: !name || !faint, // with several curves per case the legend lists the selected case only
      color: caseColor(flight.name),
      dash,
      faint,
      t: flight[at],
      y: column(flight.tracks[tracks], k),
    }));
  if (kind === "position") return each("", "e_p", 0, DASHES[0]);
  if (kind === "attitude") return each("", "angle", 0, DASHES[0]);
  if (kind === "deviation") {
    return [...each("payload", "sigma", 0, DASHES[0], "t_sigma"), ...each("agents", "sigma", 1, DASHES[1], "t_sigma")];
  }
  const { tracks, t } = cases[chosen];
  return shape.contacts.map(({ name, agent, arm }, k) => ({
    label: name,
    color: agentColor(agent),
    dash: DASHES[arm % DASHES.length],
    faint: false,
    listed: true,
    t,
    y: norms(tracks.lam, 3 * k),
  }));
}

const PLOTS = [
  { kind: "position", title: "Position error", unit: "|e| [m]", log: true },
  { kind: "attitude", title: "Attitude error", unit: "angle [deg]", log: true },
  { kind: "contact", title: "Contact forces on the payload", unit: "|λ| [N]", log: false },
  { kind: "deviation", title: "Predictive standard deviation of the residual", unit: "σ [N]", log: true },
];

/** Draws lines at model updates, a dashed line at the end of learning, and spans of internal forces and thrust limits. */
function marks({ marks: { updates, learning_end: end, internal, at_limit: limits } }) {
  return (u) => {
    const { ctx, bbox } = u;
    const at = (t) => Math.round(u.valToPos(t, "x", true)) + 0.5;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.fillStyle = ink("active");
    for (const [from, to] of internal) ctx.fillRect(at(from), bbox.top, at(to) - at(from), bbox.height);
    ctx.fillStyle = ink("limit");
    for (const spans of Object.values(limits)) {
      for (const [from, to] of spans) {
        ctx.fillRect(at(from), bbox.top, Math.max(at(to) - at(from), 2), 3 * devicePixelRatio);
      }
    }
    ctx.lineWidth = devicePixelRatio;
    ctx.strokeStyle = ink("mark");
    const rule = (t) => {
      ctx.beginPath();
      ctx.moveTo(at(t), bbox.top);
      ctx.lineTo(at(t), bbox.top + bbox.height);
      ctx.stroke();
    };
    for (const t of updates) if (t !== end) rule(t);
    ctx.setLineDash([5 * devicePixelRatio, 4 * devicePixelRatio]);
    if (updates.length && end !== null) rule(end);
    ctx.restore();
  };
}

/** Returns the legend of the event markers of the selected case. */
function key({ marks: { updates, learning_end: end, internal, at_limit: limits } }) {
  const entries = [
    ["update", "models updated", updates.length],
    ["end", "end of learning", updates.length && end !== null],
    ["active", "internal forces active", internal.length],
    ["limit", "agent at thrust limit", Object.keys(limits).length],
  ];
  const line = Object.assign(document.createElement("p"), { id: "key" });
  for (const [kind, text] of entries.filter(([, , any]) => any)) {
    const entry = document.createElement("span");
    entry.append(Object.assign(document.createElement("i"), { className: kind }), text);
    line.append(entry);
  }
  return line;
}

/** Builds the plots in an element; `seek(t)` is called with the selected time. */
export function build(element, written, seek) {
  let drawn = [];
  let markerLegend = null;
  let now = 0;
  const end = Math.max(...written.cases.map(({ t }) => t[t.length - 1]));
  const span = Math.ceil(10 * end - 1e-6) / 10; // so that the last tick is visible
  const last = (k) => k === PLOTS.length - 1;

  function one({ kind, title, unit, log }, k, chosen, others) {
    const section = document.createElement("section");
    const heading = Object.assign(document.createElement("h2"), { textContent: title });
    const legend = Object.assign(document.createElement("p"), { className: "curves" });
    section.append(heading, legend);
    element.append(section);
    const all = curves(kind, written, chosen, others);
    const data = uPlot.join(all.map(({ t, y }) => [t, log ? y.map((value) => (value > 0 ? value : null)) : y]));
    const limits = log ? logarithmic(all.map(({ y }) => y)) : null;
    const decades = (_, at) => at.map((value) => (!log || Math.abs(Math.log10(value) % 1) < 1e-9 ? value : null));
    const axis = { stroke: () => ink("text"), ticks: { show: false }, font: "12px system-ui, sans-serif" };
    axis.labelFont = axis.font;
    const lines = { stroke: () => ink("line"), width: 1 };
    const plot = new uPlot(
      {
        width: section.clientWidth,
        height: HEIGHT,
        padding: [6, 12, last(k) ? 0 : 6, 0],
        cursor: { show: false },
        legend: { show: false },
        scales: {
          x: { time: false, range: [0, span] },
          y: log ? { distr: 3, range: limits } : { range: (_, __, high) => [0, 1.08 * (high || 1)] },
        },
        axes: [
          last(k)
            ? { ...axis, grid: lines, label: "time [s]", labelSize: 18, size: AXIS - 18 }
            : { ...axis, grid: lines, size: 0, values: (_, at) => at.map(() => "") },
          { ...axis, ...(log && { filter: decades, values: powers }), grid: { ...lines, filter: decades }, size: GUTTER - 18, label: unit, labelSize: 18 },
        ],
        series: [
          {},
          ...all.map(({ color, dash, faint }) => ({
            stroke: color,
            dash,
            alpha: faint ? 0.5 : 1,
            width: faint ? 1 : 2,
            spanGaps: true,
            points: { show: false },
          })),
        ],
        hooks: { drawAxes: [marks(written.cases[chosen])] },
      },
      data,
      section,
    );
    section.append(legend);
    const cursor = Object.assign(document.createElement("div"), { className: "cursor" });
    plot.over.append(cursor);
    const readouts = all.map(({ label, color, dash, faint, listed }, n) => {
      const line = ["solid", "dashed", "dotted", "double"][DASHES.indexOf(dash)];
      const marker = document.createElement("i");
      marker.style.borderTop = `3px ${line} ${color}`;
      const value = document.createElement("b");
      const entry = Object.assign(document.createElement("span"), { className: faint ? "faint" : "" });
      entry.append(marker, label, value);
      if (listed) legend.append(entry);
      return (at) => (value.textContent = shorter(data[n + 1][at]));
    });
    const point = (event) => {
      if (event.buttons & 1) seek(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
    };
    plot.over.addEventListener("pointerdown", (event) => {
      plot.over.setPointerCapture(event.pointerId);
      point(event);
    });
    plot.over.addEventListener("pointermove", point);
    return { plot, section, cursor, readouts };
  }

  function move(t) {
    now = t;
    for (const { plot, cursor, readouts } of drawn) {
      cursor.style.left = `${(100 * t) / span}%`;
      const at = plot.valToIdx(t);
      for (const update of readouts) update(at);
    }
  }

  /** Fits the heights of the plots to the window; if they would be too small, the column scrolls. */
  function size() {
    if (!drawn.length) return;
    const used = drawn.reduce((sum, { section, plot }) => sum + section.offsetHeight - plot.root.offsetHeight, markerLegend.offsetHeight);
    const fills = getComputedStyle(element).overflowY === "auto";
    const room = (element.clientHeight - used - AXIS - 10 * PLOTS.length) / PLOTS.length;
    const height = fills ? Math.floor(Math.min(Math.max(room, MIN_HEIGHT), MAX_HEIGHT)) : HEIGHT;
    drawn.forEach(({ plot, section }, k) => {
      plot.setSize({ width: section.clientWidth, height: height + (last(k) ? AXIS : 0) });
    });
  }

  return {
    move,
    size,
    show(chosen, others) {
      for (const { plot } of drawn) plot.destroy();
      markerLegend = key(written.cases[chosen]);
      element.replaceChildren(markerLegend);
      drawn = PLOTS.map((spec, k) => one(spec, k, chosen, others));
      size();
      move(now);
    },
  };
}
