// Plots of signals over time with a common cursor; the user chooses signals and components.
import uPlot from "uplot";
import { column, norms, product, rotationVector } from "./flight.js";
import { agentColor, caseColor, ink } from "./look.js";

const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const GUTTER = 68; // px, left margin of all plots, so that their time axes are aligned
const HEIGHT = 132; // px, height of a plot without time axis in a scrolling page
const [MIN_HEIGHT, MAX_HEIGHT] = [84, 240]; // px, if the plots fill their column
const AXIS = 40; // px, height of the time axis of the last plot
const shorter = (value) => (value == null ? "–" : Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(3));

const BRIEF = 0.005; // fraction of the values that may lie below a logarithmic axis: zero crossings of a norm
const RANGE = 1e-4; // smallest value of a logarithmic axis over the largest

/** Returns the range of a logarithmic axis as in the figures, and whether it omits values. */
function logarithmic(rows, floor) {
  const values = rows.flat().filter((value) => value > 0).sort((one, other) => one - other);
  const top = values.length ? values[values.length - 1] : 0;
  if (top <= floor) return { limits: [floor, 10 * floor], omits: top > 0 };
  const usual = 0.7 * values[Math.floor(BRIEF * values.length)];
  const low = Math.max(usual, top * RANGE, floor);
  const [from, to] = [Math.log10(low), Math.log10(1.3 * top)];
  const few = Math.floor(to) <= Math.ceil(from); // fewer than two powers of ten
  return { limits: few ? [10 ** Math.floor(from), 10 ** Math.ceil(to)] : [10 ** from, 10 ** to], omits: low > usual };
}

const powers = (_, at) => at.map((value) => (value === null ? "" : String(Number(value.toPrecision(3)))));

const XYZ = ["x", "y", "z"];

/** Returns values of a track with three columns from `k` on: their norm, or one component. */
const part = (track, k, chosen) => (chosen === "norm" ? norms(track, k) : column(track, k + XYZ.indexOf(chosen)));

/** Returns the rotation from the reference attitude as its angle or a component of the rotation vector, deg. */
function rotationError({ angle, q, q_d: reference }, chosen) {
  if (chosen === "norm") return column(angle, 0);
  const k = XYZ.indexOf(chosen);
  return column(angle, 0).map((value, i) => {
    if (value === null) return null;
    return (rotationVector(product(reference, q, i))[k] * 180) / Math.PI;
  });
}

/** Returns the position error as its norm or a component, m. */
function positionError({ e_p: error, p, p_d: reference }, chosen) {
  if (chosen === "norm") return column(error, 0);
  const [at, wanted] = [part(p, 0, chosen), part(reference, 0, chosen)];
  return at.map((value, i) => (value === null ? null : value - wanted[i]));
}

/** Signals: title, symbol of its norm and components, unit, floor of a logarithmic axis, components, and curves. */
const SIGNALS = {
  position: {
    title: "Position error",
    symbol: "e",
    unit: "m",
    floor: 1e-6,
    parts: ["norm", ...XYZ],
    curves: (context, chosen) => context.byCase((tracks) => positionError(tracks, chosen)),
  },
  attitude: {
    title: "Attitude error",
    symbol: "angle",
    unit: "deg",
    floor: 1e-5,
    parts: ["norm", ...XYZ],
    curves: (context, chosen) => context.byCase((tracks) => rotationError(tracks, chosen)),
  },
  path: {
    title: "Payload position",
    symbol: "p",
    unit: "m",
    parts: XYZ,
    curves: (context, chosen) => [
      { ...context.own("reference"), color: ink("reference"), dash: DASHES[1], y: part(context.tracks.p_d, 0, chosen) },
      ...context.byCase((tracks) => part(tracks.p, 0, chosen)),
    ],
  },
  contact: {
    title: "Contact forces on the payload",
    symbol: "λ",
    unit: "N",
    parts: ["norm", ...XYZ],
    curves: (context, chosen) =>
      context.shape.contacts.map(({ name, agent, arm }, k) => ({
        ...context.own(name),
        color: agentColor(agent),
        dash: DASHES[arm % DASHES.length],
        y: part(context.tracks.lam, 3 * k, chosen),
      })),
  },
  thrust: {
    title: "Thrust",
    symbol: "u",
    unit: "N",
    parts: ["norm"],
    curves: (context) =>
      context.shape.agents.map(({ name }, k) => ({
        ...context.own(name),
        color: agentColor(k),
        dash: DASHES[k % DASHES.length],
        y: column(context.tracks.u, k),
      })),
  },
  disturbance: {
    title: "Disturbance force on the payload",
    symbol: "f",
    unit: "N",
    parts: ["norm", ...XYZ],
    curves: (context, chosen) => context.byCase((tracks) => part(tracks.disturbance, 0, chosen)),
  },
  residual: {
    title: "Residual force on the payload",
    symbol: "f",
    unit: "N",
    parts: ["norm", ...XYZ],
    curves: (context, chosen) => [
      { ...context.own("true"), color: ink("reference"), dash: DASHES[1], y: part(context.tracks.residual, 0, chosen) },
      { ...context.own("predicted"), color: context.color, y: part(context.tracks.residual_hat, 0, chosen) },
    ],
  },
  deviation: {
    title: "Predictive standard deviation of the residual",
    symbol: "σ",
    unit: "N",
    floor: 1e-6,
    parts: ["norm"],
    curves: (context) => [
      ...context.byCase(({ sigma }) => column(sigma, 0), "payload", DASHES[0], "t_sigma"),
      ...context.byCase(({ sigma }) => column(sigma, 1), "agents", DASHES[1], "t_sigma"),
    ],
  },
};
const USUAL = ["position", "attitude", "contact", "deviation"];

/** Returns the label of the vertical axis. */
function axisLabel({ symbol, unit, parts }, chosen) {
  if (parts.length === 1) return `${symbol} [${unit}]`;
  if (symbol === "angle") return chosen === "norm" ? `angle [${unit}]` : `about ${chosen} [${unit}]`;
  return chosen === "norm" ? `|${symbol}| [${unit}]` : `${symbol}_${chosen} [${unit}]`;
}

/** Returns the functions that make the curves of a plot; cases that are not selected are faint. */
function curveContext({ shape, cases }, chosen, others) {
  const visible = cases.map((flight, k) => ({ flight, faint: k !== chosen })).filter(({ faint }) => others || !faint);
  const { tracks, t, name } = cases[chosen];
  return {
    shape,
    tracks,
    color: caseColor(name),
    own: (label) => ({ label, t, dash: DASHES[0], faint: false, listed: true }),
    byCase: (values, label, dash = DASHES[0], at = "t") =>
      visible.map(({ flight, faint }) => ({
        label: label || flight.name,
        listed: !label || !faint, // with several curves per case the legend lists the selected case only
        color: caseColor(flight.name),
        dash,
        faint,
        t: flight[at],
        y: values(flight.tracks),
      })),
  };
}

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

/** Builds the plots in an element; `seek(t)` is called with the selected time, `changed` after a choice of signals. */
export function build(element, written, seek, changed) {
  let drawn = [];
  let shown = [...USUAL];
  const components = {}; // component of each signal; default: the first
  const component = (kind) => components[kind] ?? SIGNALS[kind].parts[0];
  let view = { chosen: 0, others: true };
  const menu = document.createElement("details");
  menu.id = "signals";
  menu.append(Object.assign(document.createElement("summary"), { textContent: "signals" }));
  menu.ontoggle = () => size();
  const boxes = Object.fromEntries(
    Object.entries(SIGNALS).map(([kind, { title }]) => {
      const box = Object.assign(document.createElement("input"), { type: "checkbox" });
      box.onchange = () => choose(Object.keys(SIGNALS).filter((each) => boxes[each].checked));
      const entry = document.createElement("label");
      entry.append(box, title);
      menu.append(entry);
      return [kind, box];
    }),
  );
  let markerLegend = null;
  let now = 0;
  const end = Math.max(...written.cases.map(({ t }) => t[t.length - 1]));
  const span = Math.ceil(10 * end - 1e-6) / 10; // so that the last tick is visible
  const last = (k) => k === shown.length - 1;

  /** Returns a menu of the components of a signal. */
  function componentMenu(kind) {
    const { parts, title, symbol } = SIGNALS[kind];
    const choice = Object.assign(document.createElement("select"), { title: `component: ${title}` });
    for (const each of parts) {
      const text = each !== "norm" ? each : symbol === "angle" ? "angle" : "norm";
      choice.append(Object.assign(document.createElement("option"), { value: each, textContent: text, selected: each === component(kind) }));
    }
    choice.onchange = () => {
      components[kind] = choice.value;
      choose(shown);
    };
    return choice;
  }

  function one(kind, k) {
    const signal = SIGNALS[kind];
    const chosen = component(kind);
    const log = Boolean(signal.floor) && chosen === "norm";
    const section = document.createElement("section");
    section.id = `plot-${kind}`;
    const heading = Object.assign(document.createElement("h2"), { textContent: signal.title });
    if (signal.parts.length > 1) heading.append(componentMenu(kind));
    const legend = Object.assign(document.createElement("p"), { className: "curves" });
    section.append(heading, legend);
    element.append(section);
    const all = signal.curves(curveContext(written, view.chosen, view.others), chosen);
    const data = uPlot.join(all.map(({ t, y }) => [t, log ? y.map((value) => (value > 0 ? value : null)) : y]));
    const { limits, omits } = log ? logarithmic(all.map(({ y }) => y), signal.floor) : {};
    if (omits) heading.append(Object.assign(document.createElement("small"), { textContent: `below ${Number(limits[0].toPrecision(2))} ${signal.unit}: not shown` }));
    const linear = (_, low, high) => {
      if (chosen === "norm") return [0, 1.08 * (high || 1)];
      const margin = 0.06 * (high - low || Math.abs(high) || 1);
      return [low - margin, high + margin];
    };
    const decades = (_, at) => at.map((value) => (!log || Math.abs(Math.log10(value) % 1) < 1e-9 ? value : null));
    const axis = { stroke: () => ink("text"), ticks: { show: false }, font: "12px system-ui, sans-serif" };
    axis.labelFont = axis.font;
    const lines = { stroke: () => ink("line"), width: 1 };
    const plot = new uPlot(
      {
        width: section.clientWidth,
        height: HEIGHT,
        padding: [6, 14, last(k) ? 0 : 6, 0],
        cursor: { show: false },
        legend: { show: false },
        scales: {
          x: { time: false, range: [0, span] },
          y: log ? { distr: 3, range: limits } : { range: linear },
        },
        axes: [
          last(k)
            ? { ...axis, grid: lines, label: "time [s]", labelSize: 18, size: AXIS - 18 }
            : { ...axis, grid: lines, size: 0, values: (_, at) => at.map(() => "") },
          { ...axis, ...(log && { filter: decades, values: powers }), grid: { ...lines, filter: decades }, size: GUTTER - 18, label: axisLabel(signal, chosen), labelSize: 18 },
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
        hooks: { drawAxes: [marks(written.cases[view.chosen])] },
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
    return { plot, section, heading: signal.title, axis: axisLabel(signal, chosen), legend, cursor, readouts };
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
    const above = menu.offsetHeight + markerLegend.offsetHeight;
    const used = drawn.reduce((sum, { section, plot }) => sum + section.offsetHeight - plot.root.offsetHeight, above);
    const fills = getComputedStyle(element).overflowY === "auto";
    const room = (element.clientHeight - used - AXIS - 10 * drawn.length) / drawn.length;
    const height = fills ? Math.floor(Math.min(Math.max(room, MIN_HEIGHT), MAX_HEIGHT)) : HEIGHT;
    drawn.forEach(({ plot, section }, k) => {
      plot.setSize({ width: section.clientWidth, height: height + (last(k) ? AXIS : 0) });
    });
  }

  function draw() {
    for (const { plot } of drawn) plot.destroy();
    markerLegend = key(written.cases[view.chosen]);
    element.replaceChildren(menu, markerLegend);
    drawn = shown.map((kind, k) => one(kind, k));
    size();
    move(now);
  }

  /** Shows the signals of a list, in its order; unknown names are ignored. */
  function choose(kinds) {
    shown = kinds.filter((kind) => kind in SIGNALS);
    for (const [kind, box] of Object.entries(boxes)) box.checked = shown.includes(kind);
    draw();
    changed();
  }
  for (const kind of shown) boxes[kind].checked = true;

  return {
    move,
    size,
    choose,
    show(chosen, others) {
      view = { chosen, others };
      draw();
    },
    /** Returns the signals and components as text, such as `position:x,contact`. */
    text: () => shown.map((kind) => (component(kind) === SIGNALS[kind].parts[0] ? kind : `${kind}:${component(kind)}`)).join(),
    /** Shows the signals and components of such a text. */
    read(text) {
      const kinds = [];
      for (const [kind, wanted] of text.split(",").map((each) => each.split(":"))) {
        if (!(kind in SIGNALS)) continue;
        kinds.push(kind);
        components[kind] = SIGNALS[kind].parts.includes(wanted) ? wanted : SIGNALS[kind].parts[0];
      }
      choose(kinds);
    },
    /** Returns heading, canvas and legend of each plot, for a picture of the page. */
    pictures: () =>
      drawn.map(({ heading, plot, legend }) => ({
        heading,
        canvas: plot.ctx.canvas,
        entries: [...legend.children].map(({ childNodes: [marker, label, value] }) => ({
          text: `${label.textContent} ${value.textContent}`,
          color: marker.style.borderTopColor,
        })),
      })),
    span,
  };
}
