// The grid of thumbnails. Only the rows near the window are in the page, so that it opens and scrolls fast.
"use strict";

const grid = document.getElementById("grid");
const NARROWEST_PX = 232, GAP_PX = 14, ROWS_BEYOND = 3;
const CAPTION_PX = scores() ? 64 : 46;

// Height over width of the pictures: that of the tallest frame, within reason.
const ASPECT = Math.min(1, Math.max(0.5, allFrames.reduce((most, frame) => Math.max(most, frame.height / frame.width), 0)));

let shown = [];
let caption = () => "";
const cards = new Map();

// Show other frames. `caption` makes the second line of a card from an entry of `matching`.
function showFrames(entries, newCaption) {
  shown = entries;
  caption = newCaption;
  for (const card of cards.values()) card.remove();
  cards.clear();
  layOut();
}

function places() {
  const width = grid.clientWidth;
  const columns = Math.max(1, Math.floor((width + GAP_PX) / (NARROWEST_PX + GAP_PX)));
  const card = Math.floor((width - GAP_PX * (columns - 1)) / columns);
  const picture = Math.round(card * ASPECT);
  return { columns, card, picture, row: picture + CAPTION_PX + GAP_PX };
}

function layOut() {
  const { columns, card, picture, row } = places();
  grid.style.height = `${Math.ceil(shown.length / columns) * row}px`;
  grid.style.setProperty("--picture", `${picture}px`);
  const top = -grid.getBoundingClientRect().top;
  const first = Math.max(0, Math.floor(top / row) - ROWS_BEYOND) * columns;
  const last = Math.min(shown.length, (Math.ceil((top + window.innerHeight) / row) + ROWS_BEYOND) * columns);
  for (const [i, old] of cards) {
    // The card that has the focus stays, or the keyboard would be nowhere.
    if ((i < first || i >= last) && !old.contains(document.activeElement)) {
      old.remove();
      cards.delete(i);
    }
  }
  for (let i = first; i < last; i++) if (!cards.has(i)) insert(i);
  for (const [i, item] of cards) {
    item.style.width = `${card}px`;
    item.style.transform = `translate(${(i % columns) * (card + GAP_PX)}px, ${Math.floor(i / columns) * row}px)`;
  }
}

// Cards are in the order of the frames, which is that of the Tab key.
function insert(i) {
  const item = cardOf(i);
  let before = null;
  for (const [k, other] of cards) if (k > i && (before === null || k < before[0])) before = [k, other];
  grid.insertBefore(item, before && before[1]);
  cards.set(i, item);
}

function cardOf(i) {
  const entry = shown[i], { frame } = entry;
  const lines = [node("b", {}, `frame ${frame.id}`), node("span", {}, caption(entry))];
  if (scores()) lines.push(node("span", { class: "score" }, scoreLine(frame)));
  const button = node("button", { type: "button", "aria-haspopup": "dialog" }, picture(frame, false), ...lines);
  button.addEventListener("click", () => openLarge(i));
  return node("li", { "aria-setsize": shown.length, "aria-posinset": i + 1 }, button);
}

// What the chosen run made of a frame, on one line.
function scoreLine(frame) {
  const scored = frame.markers.filter(marker => isSolved(marker) !== null);
  const solved = scored.filter(isSolved);
  if (!scored.length) return "not scored";
  if (!solved.length) return "not solved";
  const worst = ROUNDEL.errors.map(({ key, unit }) => {
    const values = solved.map(marker => valueOf(marker, key)).filter(value => value !== null);
    return values.length ? withUnit(short(Math.max(...values), 2), unit.split(" ")[0]) : "-";
  });
  if (scored.length > 1) return `${solved.length} of ${scored.length} solved, to ${worst.join(", ")}`;
  return `normal ${worst[0]}, position ${worst[1]}`;
}

// Scroll to a frame and give it the focus.
function reveal(i) {
  const { columns, row } = places();
  const top = grid.getBoundingClientRect().top + Math.floor(i / columns) * row;
  if (top < 0 || top + row > window.innerHeight) window.scrollBy(0, top - (window.innerHeight - row) / 2);
  layOut();
  cards.get(i).querySelector("button").focus({ preventScroll: true });
}

let waiting = false;
function layOutSoon() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => {
    waiting = false;
    layOut();
  });
}
window.addEventListener("scroll", layOutSoon, { passive: true });
new ResizeObserver(layOutSoon).observe(document.querySelector("main"));
