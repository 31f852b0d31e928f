// The filters beside the grid, and the start of the page.
"use strict";

const form = document.getElementById("filters");
const sort = document.getElementById("sort"), order = document.getElementById("order");
const unsolved = document.getElementById("unsolved"), runs = document.getElementById("run");
const filtered = [...ROUNDEL.variables, ...ROUNDEL.errors].filter(variable => variable.filtered);
const BINS = 36;

function option(value, text) {
  return node("option", { value }, text);
}

// Check boxes for the values of a text; nothing to choose if there is but one. Returns what is chosen, null for all.
function choices(title, values) {
  const counts = new Map();
  for (const value of values) counts.set(value, (counts.get(value) || 0) + 1);
  if (counts.size < 2) return () => null;
  const boxes = [...counts].map(([value, count]) => {
    const box = node("input", { type: "checkbox", checked: "" });
    const label = node("label", { class: "check" }, box, ` ${value} `, node("span", { class: "quiet" }, String(count)));
    return { value, box, label };
  });
  const list = node("div", { class: "boxes" }, ...boxes.map(one => one.label));
  const only = node("button", { type: "button", class: "small" }, "none");
  only.addEventListener("click", () => {
    const all = boxes.every(one => !one.box.checked);
    for (const one of boxes) one.box.checked = all;
    update();
  });
  document.getElementById("choices").append(
    node("fieldset", {}, node("legend", {}, title, " ", only), list));
  return () => {
    const chosen = boxes.filter(one => one.box.checked).map(one => one.value);
    only.textContent = chosen.length ? "none" : "all";
    return chosen.length === boxes.length ? null : new Set(chosen);
  };
}

// Two boxes for the limits of a number, over the histogram of its values.
function rangeOf({ key, title, unit }) {
  const [low, high] = ["at least", "at most"].map(which =>
    node("input", { type: "number", step: "any", "aria-label": `${title}${unit && `, ${unit}`}, ${which}` }));
  const bars = svgNode("svg", { viewBox: `0 0 ${BINS} 20`, preserveAspectRatio: "none", "aria-hidden": "true" });
  const name = node("legend", {}, title, unit ? node("span", { class: "quiet" }, ` ${unit}`) : "");
  const box = node("fieldset", { class: "range" }, name, bars, node("div", { class: "limits" }, low, "to", high));
  document.getElementById("ranges").append(box);
  let bins = [];
  // Limits that are out of sight, because the chosen run has no such values, do not hold.
  const limit = input => (box.hidden || input.value === "" ? null : Number(input.value));
  return {
    limits: () => ({ key, low: limit(low), high: limit(high) }),
    measure() {
      const values = allMarkers.map(marker => valueOf(marker, key)).filter(value => value !== null);
      bins = histogram(values);
      // What is the same for all tells no frames apart.
      box.hidden = bins.length === 0;
      if (box.hidden) return;
      [low.placeholder, high.placeholder] = [bins[0].from, bins[bins.length - 1].to].map(value => short(value));
      const most = Math.max(...bins.map(bin => bin.count));
      bars.replaceChildren(...bins.map(({ count }, i) => {
        const height = count && Math.max(1, (20 * count) / most);
        return svgNode("rect", { x: i + 0.08, y: 20 - height, width: 0.84, height });
      }));
    },
    mark() {
      const { low: from, high: to } = this.limits();
      bins.forEach((bin, i) => {
        const within = (from === null || bin.to >= from) && (to === null || bin.from <= to);
        bars.children[i].setAttribute("class", within ? "" : "out");
      });
    },
  };
}

// Counts over equal steps; over equal ratios if the values spread over decades, as errors do.
function histogram(values) {
  let low = Infinity, high = -Infinity;
  for (const value of values) [low, high] = [Math.min(low, value), Math.max(high, value)];
  if (!(low < high)) return [];
  const wide = low > 0 && high / low > 50;
  const [to, from] = wide ? [Math.log, Math.exp] : [value => value, value => value];
  const width = (to(high) - to(low)) / BINS;
  const edge = i => (i === 0 ? low : i === BINS ? high : from(to(low) + i * width));
  const bins = Array.from({ length: BINS }, (_, i) => ({ from: edge(i), to: edge(i + 1), count: 0 }));
  for (const value of values) bins[Math.min(BINS - 1, Math.floor((to(value) - to(low)) / width))].count++;
  return bins;
}

const groups = choices("Group", allFrames.map(frame => frame.group));
const kinds = choices("Marker", allMarkers.map(marker => marker.kind));
const ranges = filtered.map(rangeOf);

function update() {
  const variable = filtered.find(one => one.key === sort.value);
  const found = matching({
    groups: groups(), kinds: kinds(), unsolved: Boolean(unsolved && unsolved.checked),
    ranges: ranges.map(range => range.limits()).filter(({ low, high }) => low !== null || high !== null),
    sort: sort.value, largestFirst: Boolean(order.value),
  });
  for (const range of ranges) range.mark();
  document.getElementById("count").textContent = `${counted(found.length)} of ${counted(allFrames.length)} frames`;
  showFrames(found, ({ frame, value }) => {
    if (variable && value === null) return `no ${variable.title.toLowerCase()}`;
    if (variable) return `${variable.title.toLowerCase()} ${withUnit(short(value), variable.unit.split(" ")[0])}`;
    if (frame.markers.length > 1) return `${frame.markers.length} markers`;
    const { distance_D: distance, tilt_deg: tilt, kind } = frame.markers[0];
    return distance === null ? kind : `${short(distance)} D, tilt ${short(tilt)}\u00b0`;
  });
}

// The scores of a run are loaded when it is chosen: many runs of many frames would make the page slow to open.
function chooseRun(number) {
  const use = () => {
    run = number;
    for (const range of ranges) range.measure();
    update();
  };
  if (ROUNDEL.scores[number]) return use();
  const script = node("script", { src: `scores/${String(number).padStart(3, "0")}.js` });
  script.addEventListener("load", use);
  document.body.append(script);
}

form.addEventListener("submit", event => event.preventDefault());
form.addEventListener("input", event => (event.target === runs ? chooseRun(Number(runs.value)) : update()));
// After the event the fields have their first values again; the run is no filter, and stays.
form.addEventListener("reset", () => setTimeout(() => {
  if (runs) runs.value = String(run);
  update();
}));
for (const field of [sort, order]) field.addEventListener("input", update);
const contours = document.getElementById("contours");
contours.addEventListener("input", () => document.body.classList.toggle("bare", !contours.checked));

for (const range of ranges) range.measure();
sort.append(option("", "frame"), ...filtered.map(({ key, title }) => option(key, title.toLowerCase())));
if (runs) {
  runs.append(...ROUNDEL.runs.map((title, i) => option(i, title)));
  runs.value = String(run);
}
// On a small screen the frames come first.
document.getElementById("panel").open = window.matchMedia("(min-width: 50rem)").matches;
update();

// An address that ends with #frame-12 opens this frame.
const asked = /^#frame-(\d+)$/.exec(location.hash);
const at = asked ? shown.findIndex(({ frame }) => frame.id === Number(asked[1])) : -1;
if (at >= 0) openLarge(at);
