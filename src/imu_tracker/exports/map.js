"use strict";
const EARTH_M = 6378137, MAX_LAT = 89.9, NEAR_PX = 24, DOTS = 1500, APART_PX = 8, MIN_SPAN_M = 20;
const $ = id => document.getElementById(id);
let data = { tracks: [], modes: [], segments: [] };
const points = [];   // all of them, in the order of time of each track
const under = [], over = [];   // what else is drawn, below and above the track

// ---------------------------------------------------------------- the points
// Mercator in radians, y up. Longitudes go on beyond 180 degrees, so that a track
// that crosses that meridian stays in one piece.
const mercator = lat => Math.log(Math.tan(Math.PI / 4 + Math.max(-MAX_LAT, Math.min(MAX_LAT, lat)) * Math.PI / 360));
function placeOf(lat, lon) {
  const last = points.at(-1);
  let x = lon * Math.PI / 180;
  if (last) x += Math.round((last.x - x) / (2 * Math.PI)) * 2 * Math.PI;
  return { x, y: mercator(lat), lat, lon };
}
function setTrack(track) {
  data = track;
  points.length = 0;
  for (const [number, segment] of data.segments.entries()) {
    let t = 0, lat = 0, lon = 0;
    for (let i = 0; i < segment.t_ms.length; i++) {
      t += segment.t_ms[i]; lat += segment.lat_e7[i]; lon += segment.lon_e7[i];
      points.push({
        ...placeOf(lat * 1e-7, lon * 1e-7), t, segment: number, track: segment.track,
        alt: segment.alt_dm[i], speed: segment.speed_cmps[i], course: segment.course_ddeg[i],
        r95: segment.r95_cm[i] / 100, mode: data.modes[segment.mode[i]],
      });
    }
  }
}
const metresPerUnit = p => EARTH_M * Math.cos(Math.max(-MAX_LAT, Math.min(MAX_LAT, p.lat)) * Math.PI / 180);
const nameOf = p => {
  const rows = [
    `<b>${new Date(p.t).toISOString().replace("T", " ").replace("Z", " UTC")}</b>`,
    `<i>&#9679;</i> ${p.mode[0]}: ${p.mode[2]}`,
    `speed ${(p.speed / 100).toFixed(2)} m/s (${(p.speed * 0.036).toFixed(0)} km/h)` +
      (p.course === null ? "" : `, course ${(p.course / 10).toFixed(1)}&deg;`),
    `r95 ${p.r95.toFixed(2)} m`,
    `${p.lat.toFixed(7)}, ${p.lon.toFixed(7)}` + (p.alt === null ? "" : `, ${(p.alt / 10).toFixed(1)} m high`),
  ];
  if (data.tracks.length > 1) rows.push(escaped(data.tracks[p.track]));
  return rows.join("<br>");
};
const escaped = text => text.replace(/[&<>"]/g, c => `&#${c.charCodeAt(0)};`);

// ------------------------------------------------------------------ the view
const canvas = $("map"), pen = canvas.getContext("2d");
const view = { x: 0, y: 0, k: 1 };   // centre, and pixels per radian
let width = 0, height = 0, chosen = null, isDue = false;
const toScreen = p => [width / 2 + (p.x - view.x) * view.k, height / 2 - (p.y - view.y) * view.k];
const redraw = () => { if (!isDue) { isDue = true; requestAnimationFrame(draw); } };

function fit() {
  if (!points.length) return;
  let [west, east, south, north] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const p of points) {
    west = Math.min(west, p.x); east = Math.max(east, p.x);
    south = Math.min(south, p.y); north = Math.max(north, p.y);
  }
  // Beside the legend on a wide screen, below it on a narrow one.
  const legend = $("legend").getBoundingClientRect(), map = canvas.getBoundingClientRect(), isWide = width > height;
  const left = isWide ? legend.right - map.left : 0, right = isWide ? 56 : 0, top = isWide ? 0 : legend.bottom - map.top, edge = 50;
  const least = MIN_SPAN_M / metresPerUnit(points[0]);
  view.k = Math.min(
    Math.max(50, width - left - right - edge) / Math.max(east - west, least),
    Math.max(50, height - top - 2 * edge) / Math.max(north - south, least));
  view.x = (west + east) / 2 - (left - right) / 2 / view.k;
  view.y = (south + north) / 2 + top / 2 / view.k;
  redraw();
}
function zoom(factor, px = width / 2, py = height / 2) {
  const k = Math.max(20, Math.min(5e9, view.k * factor));
  view.x += (px - width / 2) * (1 / view.k - 1 / k);
  view.y -= (py - height / 2) * (1 / view.k - 1 / k);
  view.k = k;
  redraw();
}

// ------------------------------------------------------------------- drawing
function draw() {
  isDue = false;
  const ratio = window.devicePixelRatio || 1;
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  for (const paint of under) paint();
  drawCircles();
  drawLines();
  drawDots();
  for (const paint of over) paint();
  if (points.length && !over.length) { mark(points[0], "#fff", "#1a1a1a"); mark(points.at(-1), "#1a1a1a", "#fff"); }
  if (chosen) { circle(chosen, 0.18); mark(chosen, chosen.mode[1], "#fff"); }
  drawScale();
  placeTip();
}
const isShown = (x, y, r) => x > -r && y > -r && x < width + r && y < height + r;
function circle(p, alpha) {
  const [x, y] = toScreen(p), r = p.r95 / metresPerUnit(p) * view.k;
  if (r < 2 || !isShown(x, y, r)) return;
  pen.beginPath();
  pen.arc(x, y, r, 0, 2 * Math.PI);
  pen.fillStyle = pen.strokeStyle = p.mode[1];
  pen.lineWidth = 1;
  pen.globalAlpha = alpha; pen.fill();
  pen.globalAlpha = Math.min(1, 4 * alpha); pen.stroke();
  pen.globalAlpha = 1;
}
function drawCircles() {
  let last = null;
  for (const p of points) {   // far enough apart to be told from one another
    const apart = last ? Math.hypot(p.x - last.x, p.y - last.y) * view.k : Infinity;
    const r = p.r95 / metresPerUnit(p) * view.k;
    if (apart >= Math.max(12, r) || (last && p.r95 > 1.5 * last.r95)) { circle(p, 0.05); last = p; }
  }
}
function drawLines() {
  pen.lineWidth = 3; pen.lineJoin = pen.lineCap = "round";
  let last = null, at = null, colour = null;
  for (const p of points) {
    const here = toScreen(p);
    const isJoined = last && last.segment === p.segment;
    if (!isJoined || p.mode[1] !== colour) {
      if (colour) pen.stroke();
      pen.beginPath();
      pen.strokeStyle = colour = p.mode[1];
      pen.moveTo(...(isJoined ? at : here));
      pen.lineTo(...here);
      at = here;
    } else if (Math.abs(here[0] - at[0]) + Math.abs(here[1] - at[1]) > 0.7) {
      pen.lineTo(...here);
      at = here;
    }
    last = p;
  }
  if (colour) pen.stroke();
}
function drawDots() {
  const shown = points.filter(p => isShown(...toScreen(p), 0));
  if (shown.length > DOTS || !shown.length) return;
  let length = 0;   // dots that touch would hide the line
  for (let i = 1; i < shown.length; i++) length += Math.hypot(shown[i].x - shown[i - 1].x, shown[i].y - shown[i - 1].y) * view.k;
  if (length / shown.length < APART_PX) return;
  for (const p of shown) {
    pen.beginPath();
    pen.arc(...toScreen(p), 3.2, 0, 2 * Math.PI);
    pen.fillStyle = p.mode[1]; pen.fill();
    pen.strokeStyle = "#fff"; pen.lineWidth = 1; pen.stroke();
  }
}
function mark(p, fill, edge) {
  pen.beginPath();
  pen.arc(...toScreen(p), 6, 0, 2 * Math.PI);
  pen.fillStyle = fill; pen.fill();
  pen.lineWidth = 2; pen.strokeStyle = edge; pen.stroke();
  pen.beginPath();
  pen.arc(...toScreen(p), 7.5, 0, 2 * Math.PI);
  pen.lineWidth = 1; pen.strokeStyle = "#1a1a1a"; pen.stroke();
}
function drawScale() {
  $("scale").style.display = points.length ? "" : "none";
  if (!points.length) return;
  const lat = (2 * Math.atan(Math.exp(view.y)) - Math.PI / 2) * 180 / Math.PI;
  const metresPerPixel = metresPerUnit({ lat }) / view.k;
  const most = 140 * metresPerPixel, ten = 10 ** Math.floor(Math.log10(most));
  const metres = [5, 2, 1].map(n => n * ten).find(n => n <= most);
  $("length").textContent = metres >= 1000 ? `${metres / 1000} km` : metres >= 1 ? `${metres} m` : `${Math.round(metres * 100)} cm`;
  $("scale").querySelector("span").style.width = `${metres / metresPerPixel}px`;
}
function placeTip() {
  const tip = $("tip");
  tip.style.display = chosen ? "block" : "none";
  if (!chosen) return;
  const [x, y] = toScreen(chosen), box = tip.getBoundingClientRect();
  const left = x + 16 + box.width < width ? x + 16 : x - 16 - box.width;
  tip.style.left = `${Math.max(4, Math.min(width - box.width - 4, left))}px`;
  tip.style.top = `${Math.max(4, Math.min(height - box.height - 4, y - box.height - 12))}px`;
}

// ------------------------------------------------------------ hands and keys
function choose(p) {
  if (p === chosen) return;
  chosen = p;
  if (p) {
    $("tip").innerHTML = nameOf(p);
    $("tip").querySelector("i").style.color = p.mode[1];
  }
  redraw();
}
function nearest(px, py) {
  let best = null, least = NEAR_PX;
  for (const p of points) {
    const [x, y] = toScreen(p), apart = Math.hypot(x - px, y - py);
    if (apart < least) { least = apart; best = p; }
  }
  return best;
}
const fingers = new Map();
let moved = 0;
canvas.addEventListener("pointerdown", e => {
  canvas.setPointerCapture(e.pointerId);
  fingers.set(e.pointerId, [e.offsetX, e.offsetY]);
  moved = fingers.size > 1 ? Infinity : 0;
});
canvas.addEventListener("pointermove", e => {
  const before = fingers.get(e.pointerId), now = [e.offsetX, e.offsetY];
  if (!before) { choose(nearest(...now)); return; }
  const [dx, dy] = [now[0] - before[0], now[1] - before[1]];
  moved += Math.abs(dx) + Math.abs(dy);
  if (fingers.size === 1) {
    view.x -= dx / view.k; view.y += dy / view.k;
    redraw();
  } else if (fingers.size === 2) {
    const [other] = [...fingers].filter(([id]) => id !== e.pointerId).map(([, at]) => at);
    const span = at => Math.hypot(at[0] - other[0], at[1] - other[1]) || 1;
    zoom(span(now) / span(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    view.x -= dx / 2 / view.k; view.y += dy / 2 / view.k;
  }
  fingers.set(e.pointerId, now);
});
function lift(e) {
  const was = fingers.delete(e.pointerId);
  if (was && e.type === "pointerup" && moved < 6) choose(nearest(e.offsetX, e.offsetY));
}
for (const type of ["pointerup", "pointercancel"]) canvas.addEventListener(type, lift);
canvas.addEventListener("wheel", e => {
  e.preventDefault();
  zoom(Math.exp(-e.deltaY * (e.deltaMode ? 0.05 : 0.002)), e.offsetX, e.offsetY);
}, { passive: false });
canvas.addEventListener("dblclick", e => zoom(2, e.offsetX, e.offsetY));
$("in").onclick = () => zoom(1.6);
$("out").onclick = () => zoom(1 / 1.6);
$("fit").onclick = fit;
document.addEventListener("keydown", e => {
  const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
  if (e.key === "+" || e.key === "=") zoom(1.6);
  else if (e.key === "-") zoom(1 / 1.6);
  else if (e.key === "0") fit();
  else if (e.key === "Escape") choose(null);
  else if (step && points.length) {
    const at = chosen ? points.indexOf(chosen) + step : step > 0 ? 0 : points.length - 1;
    choose(points[Math.max(0, Math.min(points.length - 1, at))]);
    const [x, y] = toScreen(chosen);
    if (!isShown(x, y, -20)) { view.x = chosen.x; view.y = chosen.y; redraw(); }
  }
});

let hasView = false;
function resize() {
  const ratio = window.devicePixelRatio || 1;
  width = canvas.clientWidth; height = canvas.clientHeight;
  canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  if (!hasView && width && height) { hasView = true; fit(); }
  redraw();
}
window.addEventListener("resize", resize);
resize();
