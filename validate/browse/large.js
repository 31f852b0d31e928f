// The larger view of a frame: its picture, and the truth and scores of each of its markers.
"use strict";

const large = document.getElementById("large");
const part = name => document.getElementById(`large-${name}`);
let current = 0;
// The id of the marker that is looked at closely, kept from frame to frame; null for the whole frame.
let closeUp = null;

function openLarge(i) {
  current = i;
  fillLarge();
  large.showModal();
}

function fillLarge() {
  const { frame } = shown[current];
  part("title").textContent = `Frame ${frame.id}`;
  part("facts").textContent = `group ${frame.group}, ${counted(current + 1)} of ${counted(shown.length)} shown`;
  document.getElementById("previous").disabled = current === 0;
  document.getElementById("next").disabled = current === shown.length - 1;
  part("picture").replaceChildren(picture(frame, true));
  part("table").replaceChildren(...tableOf(frame));
  part("note").textContent = noteOf(frame);
  look();
  history.replaceState(null, "", `#frame-${frame.id}`);
}

function noteOf(frame) {
  if (!frame.suffix) return "Points mode: this frame has no image. Dots are some of its edge points.";
  if (ROUNDEL.images) return "Image and contours in the pixels of the image. A marker's button enlarges it.";
  return "The picture is the thumbnail. To see every pixel, write the page with --images.";
}

function look() {
  const { frame } = shown[current];
  const marker = frame.markers.find(one => one.id === closeUp && one.outline.length);
  const box = marker ? surroundings(marker) : [-0.5, -0.5, frame.width, frame.height];
  const svg = part("picture").firstChild;
  svg.setAttribute("viewBox", box.join(" "));
  svg.classList.toggle("close", marker !== undefined);
  svg.style.aspectRatio = `${box[2]} / ${box[3]}`;
  for (const button of part("table").querySelectorAll("button")) {
    button.setAttribute("aria-pressed", String(marker !== undefined && button.value === String(marker.id)));
  }
}

// Rows are quantities, columns are markers; a row without any value is left out.
function tableOf(frame) {
  const heads = frame.markers.map(marker => {
    const text = frame.markers.length > 1 ? `${marker.kind} ${marker.id}` : marker.kind;
    const button = node("button", { type: "button", value: marker.id, title: "Look at this marker" }, text);
    button.addEventListener("click", () => {
      closeUp = closeUp === marker.id ? null : marker.id;
      look();
    });
    return node("th", { scope: "col" }, button);
  });
  const rows = [
    ...ROUNDEL.variables.map(({ key, title, unit }) => row(frame, title, unit, marker => marker[key])),
    ...ROUNDEL.texts.map(({ key, title }) => row(frame, title, "", marker => marker[key])),
  ];
  if (scores()) {
    rows.push(
      row(frame, "Solved", "", marker => ({ true: "yes", false: "no", null: "not scored" })[isSolved(marker)]),
      row(frame, "Reason", "", reasonOf),
      ...ROUNDEL.errors.map(({ key, title, unit }) => row(frame, title, unit, marker => valueOf(marker, key))));
  }
  const head = node("tr", {}, node("th", { scope: "col" }, "Marker"), ...heads);
  return [node("thead", {}, head), node("tbody", {}, ...rows.filter(Boolean))];
}

function row(frame, title, unit, valueFor) {
  const values = frame.markers.map(valueFor);
  if (values.every(value => value === null)) return null;
  const cells = values.map(value => node("td", {}, value === null ? "-" : withUnit(String(value), unit)));
  return node("tr", {}, node("th", { scope: "row" }, title), ...cells);
}

function step(by) {
  if (!shown[current + by]) return;
  current += by;
  fillLarge();
}

document.getElementById("previous").addEventListener("click", () => step(-1));
document.getElementById("next").addEventListener("click", () => step(1));
document.getElementById("close").addEventListener("click", () => large.close());
large.addEventListener("keydown", event => {
  const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!by || event.altKey || event.ctrlKey || event.metaKey) return;
  event.preventDefault();
  step(by);
});
// A click beside the view, on its backdrop, closes it too.
large.addEventListener("click", event => {
  if (event.target === large) large.close();
});
large.addEventListener("close", () => {
  history.replaceState(null, "", " ");
  reveal(current);
});
