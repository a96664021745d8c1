// The plots: errors, contact forces and deviations over time, under one cursor.
import uPlot from "uplot";
import { column, norms } from "./flight.js";
import { agentColor, caseColor, ink } from "./look.js";

const DASHES = [[], [7, 4], [2, 3], [9, 3, 2, 3]];
const GUTTER = 58; // px, left of every plot: their time axes lie below each other
const HEIGHT = 132; // px, of a plot without a time axis
const AXIS = 40; // px, for the time axis of the last
const shorter = (value) => (value == null ? "–" : Math.abs(value) >= 100 ? value.toFixed(0) : value.toPrecision(3));

/** Curves of one plot: each with its label, colour, dashes, times and values; those not chosen are faint. */
function curves(kind, { shape, cases }, chosen, others) {
  const seen = cases.map((flight, k) => ({ flight, faint: k !== chosen })).filter(({ faint }) => others || !faint);
  const each = (name, tracks, k, dash, at = "t") =>
    seen.map(({ flight, faint }) => ({
      label: name ? `${flight.name} ${name}` : flight.name,
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
    t,
    y: norms(tracks.lam, 3 * k),
  }));
}

const PLOTS = [
  { kind: "position", title: "Position error", unit: "|e_p| [m]", log: true },
  { kind: "attitude", title: "Attitude error, angle", unit: "angle [deg]", log: true },
  { kind: "contact", title: "Contact forces on the payload", unit: "|λ| [N]", log: false },
  { kind: "deviation", title: "Predictive deviation of learned forces", unit: "σ [N]", log: true },
];

/** Vertical lines where models were updated, dashed where learning ends, grey where internal forces act. */
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
    if (updates.length) rule(end);
    ctx.restore();
  };
}

/** The plots in an element; `seek(t)` is called where the reader points. */
export function build(element, written, seek) {
  let drawn = [];
  let now = 0;
  const end = Math.max(...written.cases.map(({ t }) => t[t.length - 1]));

  function one({ kind, title, unit, log }, last, chosen, others) {
    const section = document.createElement("section");
    section.append(Object.assign(document.createElement("h2"), { textContent: title }));
    element.append(section);
    const all = curves(kind, written, chosen, others);
    const positive = (values) => (log ? values.map((value) => (value > 0 ? value : null)) : values);
    const data = uPlot.join(all.map(({ t, y }) => [t, positive(y)]));
    const axis = { stroke: () => ink("text"), grid: { stroke: () => ink("line"), width: 1 }, ticks: { show: false } };
    const plot = new uPlot(
      {
        width: section.clientWidth,
        height: HEIGHT + (last ? AXIS : 0),
        padding: [6, 10, last ? 0 : 8, 0],
        cursor: { show: false },
        legend: { live: true, markers: { width: 0 } },
        scales: { x: { time: false, range: [0, end] }, y: log ? { distr: 3 } : { range: (_, __, high) => [0, 1.08 * (high || 1)] } },
        axes: [
          last ? { ...axis, label: "time [s]", labelSize: 18, size: 22 } : { ...axis, size: 0, values: (_, at) => at.map(() => "") },
          { ...axis, size: GUTTER - 18, label: unit, labelSize: 18 },
        ],
        series: [
          { label: "t", value: (_, t) => (t == null ? "–" : t.toFixed(2)) },
          ...all.map(({ label, color, dash, faint }) => ({
            label,
            stroke: color,
            dash,
            alpha: faint ? 0.45 : 1,
            width: faint ? 1 : 2,
            spanGaps: true,
            points: { show: false },
            value: (_, value) => shorter(value),
          })),
        ],
        hooks: { drawAxes: [marks(written.cases[chosen])] },
      },
      data,
      section,
    );
    const cursor = Object.assign(document.createElement("div"), { className: "cursor" });
    plot.over.append(cursor);
    const entries = section.querySelectorAll(".u-legend .u-series");
    entries[0].hidden = true; // the time is told once, below the scene
    all.forEach(({ color, dash, faint }, k) => {
      const marker = entries[k + 1].querySelector(".u-marker");
      marker.style.borderTop = `3px ${["solid", "dashed", "dotted", "double"][DASHES.indexOf(dash)]} ${color}`;
      entries[k + 1].classList.toggle("faint", faint);
    });
    const point = (event) => {
      if (event.buttons & 1) seek(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
    };
    plot.over.addEventListener("pointerdown", (event) => {
      plot.over.setPointerCapture(event.pointerId);
      point(event);
    });
    plot.over.addEventListener("pointermove", point);
    return { plot, section, cursor, log };
  }

  function move(t) {
    now = t;
    for (const { plot, cursor } of drawn) {
      cursor.style.transform = `translateX(${plot.valToPos(t, "x").toFixed(1)}px)`;
      plot.setLegend({ idx: plot.valToIdx(t) }, false);
    }
  }

  return {
    move,
    show(chosen, others) {
      for (const { plot, section } of drawn) {
        plot.destroy();
        section.remove();
      }
      drawn = PLOTS.map((spec, k) => one(spec, k === PLOTS.length - 1, chosen, others));
      move(now);
    },
    size() {
      drawn.forEach(({ plot, section }, k) => {
        plot.setSize({ width: section.clientWidth, height: HEIGHT + (k === drawn.length - 1 ? AXIS : 0) });
      });
      move(now);
    },
  };
}
