// The picture of a frame: its image or, in points mode, its points, under the true contours. All text is set as text.
"use strict";

const SVG = "http://www.w3.org/2000/svg";

function node(name, attributes = {}, ...children) {
  return filled(document.createElement(name), attributes, children);
}

function svgNode(name, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, name), attributes, children);
}

function filled(element, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

// Differences in hundredths of a pixel, as points in pixels.
function unpacked(steps) {
  const points = [];
  for (let i = 0, x = 0, y = 0; i < steps.length; i += 2) points.push([(x += steps[i]) / 100, (y += steps[i + 1]) / 100]);
  return points;
}

// An outline as the data of a path: that of a circle a smooth closed curve through its points (Catmull-Rom).
function pathOf(marker) {
  const points = unpacked(marker.outline), count = points.length;
  const at = i => points[(i + count) % count];
  if (marker.radius_m === null || !marker.closed) return `M${points.join("L")}${marker.closed ? "Z" : ""}`;
  const pieces = points.map((from, i) => {
    const [before, to, after] = [at(i - 1), at(i + 1), at(i + 2)];
    const control = (point, a, b) => [0, 1].map(axis => (point[axis] + (b[axis] - a[axis]) / 6).toFixed(3));
    return `C${control(from, before, to)} ${control(to, after, from)} ${to}`;
  });
  return `M${at(0)}${pieces.join("")}Z`;
}

function fileName(frame) {
  return String(frame.id).padStart(6, "0");
}

// An SVG in the frame's own pixels; `whole` has the copied image instead of the thumbnail, if there is one.
function picture(frame, whole) {
  const { width, height } = frame;
  // The centre of pixel (0, 0) is the origin, so the raster begins half a pixel before it.
  const raster = { x: -0.5, y: -0.5, width, height };
  const svg = svgNode("svg", { viewBox: `-0.5 -0.5 ${width} ${height}`, role: "img", "aria-label": described(frame) });
  if (frame.suffix) {
    const href = whole && ROUNDEL.images ? `images/${fileName(frame)}${frame.suffix}` : `thumbs/${fileName(frame)}.jpg`;
    svg.append(svgNode("image", { ...raster, href, preserveAspectRatio: "none" }));
  } else {
    svg.append(svgNode("rect", { ...raster, class: "blank" }));
  }
  for (const marker of frame.markers) svg.append(...drawn(marker));
  return svg;
}

function drawn(marker) {
  const parts = [];
  if (marker.points && marker.points.length) {
    // Dots of the same size at any scale: lines without length, with round ends.
    const d = unpacked(marker.points).map(([x, y]) => `M${x} ${y}h0`).join("");
    parts.push(svgNode("path", { d, class: "point" }));
  }
  if (marker.outline.length) {
    const kind = isSolved(marker) === false ? "contour lost" : "contour";
    parts.push(svgNode("path", { d: pathOf(marker), class: kind }));
  }
  return parts;
}

function described(frame) {
  const what = frame.suffix ? "image" : "points";
  return `Frame ${frame.id}: ${what} and true contours`;
}

// The part of a frame round a marker, as a viewBox.
function surroundings(marker) {
  const points = unpacked(marker.outline);
  const [xs, ys] = [0, 1].map(axis => points.map(point => point[axis]));
  const [left, right, top, bottom] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  const margin = Math.max(4, 0.25 * Math.max(right - left, bottom - top));
  return [left - margin, top - margin, right - left + 2 * margin, bottom - top + 2 * margin];
}
