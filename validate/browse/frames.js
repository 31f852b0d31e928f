// Frames and markers, from the columns of data.js; what is filtered, and in which order it is shown.
"use strict";

const allFrames = [];
const allMarkers = [];

for (const shard of ROUNDEL.shards) {
  const first = allFrames.length, columns = shard.markers;
  shard.frames.id.forEach((id, i) => {
    allFrames.push({
      id, group: shard.frames.group[i], suffix: shard.frames.suffix[i],
      width: shard.frames.width_px[i], height: shard.frames.height_px[i], markers: [],
    });
  });
  columns.frame.forEach((frame, i) => {
    const marker = { number: allMarkers.length };
    for (const key in columns) marker[key] = columns[key][i];
    marker.frame = allFrames[first + frame];
    marker.frame.markers.push(marker);
    allMarkers.push(marker);
  });
}

const errorKeys = new Set(ROUNDEL.errors.map(error => error.key));
let run = ROUNDEL.run;

// The columns of the chosen run; none without a report.
function scores() {
  return ROUNDEL.scores[run];
}

// A number of a marker, of the truth or of the chosen run; null where there is none.
function valueOf(marker, key) {
  return errorKeys.has(key) ? scores()[key][marker.number] : marker[key];
}

// Whether the chosen run solved a marker; null if it was not scored.
function isSolved(marker) {
  const columns = scores();
  return columns && columns.solved[marker.number] !== null ? Boolean(columns.solved[marker.number]) : null;
}

function reasonOf(marker) {
  return scores().reason[marker.number];
}

function fits(marker, wanted) {
  if (wanted.kinds && !wanted.kinds.has(marker.kind)) return false;
  if (wanted.unsolved && isSolved(marker) !== false) return false;
  return wanted.ranges.every(({ key, low, high }) => {
    const value = valueOf(marker, key);
    return value !== null && (low === null || value >= low) && (high === null || value <= high);
  });
}

// The frames that have a marker which fits everything wanted, as {frame, value}; `value` is what they are sorted by.
function matching(wanted) {
  const found = [];
  for (const frame of allFrames) {
    if (wanted.groups && !wanted.groups.has(frame.group)) continue;
    const those = frame.markers.filter(marker => fits(marker, wanted));
    if (those.length) found.push({ frame, value: wanted.sort ? leading(those, wanted) : frame.id });
  }
  const sign = wanted.largestFirst ? -1 : 1;
  // Frames without a value come last in either order.
  return found.sort((a, b) =>
    (a.value === null) - (b.value === null) || sign * (a.value - b.value) || a.frame.id - b.frame.id);
}

// Of several markers, the one that comes first decides where the frame stands.
function leading(those, wanted) {
  const values = those.map(marker => valueOf(marker, wanted.sort)).filter(value => value !== null);
  return values.length ? values.reduce((a, b) => (wanted.largestFirst ? a > b : a < b) ? a : b) : null;
}

// A number as it is shown in little room.
function short(value, digits = 3) {
  return String(Number(value.toPrecision(digits)));
}

function withUnit(text, unit) {
  return unit === "\u00b0" || !unit ? text + unit : `${text} ${unit}`;
}

function counted(number) {
  return number.toLocaleString("en");
}
