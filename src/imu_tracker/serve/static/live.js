"use strict";
// The live part of the page: events of the server to numbers, and what moves on the map.
const STALE_MS = 5000, MOST_POINTS = 20000, GAP_MS = 2500, TILE_PX = 256;
const live = { row: null, heardMs: 0, status: null, statusMs: 0, route: [], tiles: null, isFollowing: true, isOpen: false };
const text = (id, value) => { const e = $(id); if (e.textContent !== value) e.textContent = value; };
const isNumber = value => typeof value === "number" && Number.isFinite(value);
const metres = m => m >= 9995 ? `${(m / 1000).toFixed(1)} km` : m >= 100 ? `${Math.round(m)} m` : `${m.toFixed(1)} m`;
const duration = s => s < 90 ? `${Math.round(s)} s` : s < 5400 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`;
const modeOf = name => data.modes.find(mode => mode[0] === name) ?? [name, "#888", name];

// ------------------------------------------------------------------- what is heard
function listen() {
  const source = new EventSource("events");
  source.addEventListener("hello", e => { live.isOpen = true; hello(JSON.parse(e.data)); });
  source.addEventListener("row", e => addRow(JSON.parse(e.data)));
  source.addEventListener("status", e => { live.status = JSON.parse(e.data); live.statusMs = performance.now(); show(); });
  source.onerror = () => {
    live.isOpen = false;
    show();
    if (source.readyState === EventSource.CLOSED) setTimeout(listen, 5000);
  };
}
function hello(told) {
  const isFirst = !points.length;
  choose(null);
  setTrack(told.track);
  live.route = told.route.map(([name, lat, lon]) => ({ name, ...placeOf(lat, lon) }));
  live.tiles = told.tiles;
  $("thanks").hidden = !told.tiles?.attribution;
  $("thanks").textContent = (told.tiles?.attribution ?? "").replace(/<[^>]*>/g, "");
  fill("colours", data.modes.map(([name, colour, title]) => [`${title} (${name})`, "", colour]));
  if (isFirst) fit();
  redraw();
}
function addRow(row) {
  const last = points.at(-1), t = Math.round(row.utc_s * 1000);
  live.row = row; live.heardMs = performance.now();
  if (!last || last.t !== t) {
    const isNew = !last || !(t > last.t && t - last.t <= GAP_MS);
    points.push({
      ...placeOf(row.lat_deg, row.lon_deg), t, segment: (last?.segment ?? 0) + (isNew ? 1 : 0), track: 0,
      alt: isNumber(row.alt_m) ? row.alt_m * 10 : null, speed: row.speed_mps * 100,
      course: isNumber(row.course_deg) ? row.course_deg * 10 : null, r95: row.r95_m, mode: modeOf(row.mode),
    });
    if (points.length > MOST_POINTS) points.splice(0, 1000);
    if (!last) fit();
  }
  if (live.isFollowing) centre();
  show(); redraw();
}

// ------------------------------------------------------------------ what is written
function outage() {
  const age = live.status?.fix_age_s;
  if (!live.row || live.row.has_fix) return "";
  return isNumber(age) ? `, ${duration(age + (performance.now() - live.statusMs) / 1000)} without GPS` : ", without GPS";
}
function show() {
  const row = live.row, status = live.status;
  const silentMs = performance.now() - Math.max(live.heardMs, 0);
  let alarm = "";
  if (!live.isOpen) alarm = "The server does not answer; trying again";
  else if (status?.away) alarm = `${status.away}; this is where it was last`;
  else if (status?.log_is_failing) alarm = "The disk takes no rows: full or broken?";
  else if (row && silentMs > STALE_MS) alarm = `No row for ${duration(silentMs / 1000)}`;
  $("alarm").hidden = !alarm; text("alarm", alarm);
  const isOld = !live.isOpen || !!status?.away || (row && silentMs > STALE_MS);
  document.body.classList.toggle("old", !!isOld);
  const [name, colour, title] = row ? modeOf(row.mode) : ["", "", ""];
  $("state").firstElementChild.style.background = colour;
  $("state").lastElementChild.textContent = row ? title + (isOld ? "" : outage()) : status?.state ?? "waiting for the first row";
  document.title = row ? `${metres(row.r95_m)}: ${title}` : "imu-tracker";
  if (row) {
    text("r95", metres(row.r95_m));
    text("speed", `${(row.speed_mps * 3.6).toFixed(row.speed_mps < 2.7 ? 1 : 0)} km/h`);
    text("course", isNumber(row.course_deg) ? `${Math.round(row.course_deg) % 360}\u00b0` : "\u2013");
    text("height", isNumber(row.alt_m) ? `${Math.round(row.alt_m)} m` : "\u2013");
    text("place", `${row.lat_deg.toFixed(6)}, ${row.lon_deg.toFixed(6)} at ${new Date(row.utc_s * 1000).toISOString().slice(0, 19).replace("T", " ")} UTC`);
  }
  showGuide(row?.guide);
  showSensors(status);
}
function showGuide(guide) {
  $("guide").hidden = !guide;
  if (!guide) return;
  const isUnsure = guide.state === "cannot tell";
  const side = Math.abs(guide.cross_track_m) < 0.5 ? "on it" : `${metres(Math.abs(guide.cross_track_m))} ${guide.cross_track_m > 0 ? "right" : "left"}`;
  document.querySelector("#guide b").textContent = guide.waypoint;
  document.querySelector("#guide small").textContent =
    guide.state === "arrived" ? "arrived" : isUnsure ? "cannot tell: r95 is too large" : `${guide.number} of ${guide.total}, ${metres(guide.rest_m)} in all`;
  text("distance", isUnsure ? "\u2013" : metres(guide.distance_m));
  text("bearing", isUnsure ? "\u2013" : `${Math.round(guide.bearing_deg) % 360}\u00b0`);
  text("beside", isUnsure ? "\u2013" : side);
  text("togo", !isUnsure && isNumber(guide.time_to_go_s) ? duration(guide.time_to_go_s) : "\u2013");
}
function showSensors(status) {
  if (!status) return;
  const imu = status.imu, gps = status.gps, lines = [];
  const isLost = !!imu && !imu.is_ready;
  if (imu) lines.push([isLost ? "IMU: no answer" : `IMU: ${imu.chip}, ${Math.round(status.imu_rate_hz ?? 0)} samples/s`, isLost ? "bad" : ""]);
  if (gps) lines.push([`receiver: ${gps.state}${gps.detail ? `, ${gps.detail}` : ""}`, gps.state === "ok" ? "" : "bad"]);
  if (!imu && !gps && status.source) lines.push([status.source, ""]);
  if (isNumber(status.fix_age_s)) lines.push([`last fix ${duration(status.fix_age_s)} ago`, ""]);
  for (const [kind, count] of Object.entries(status.faults ?? {})) if (count) lines.push([`${kind.replaceAll("_", " ")}: ${count}`, ""]);
  if (isNumber(status.disk_free_mb)) lines.push([`disk: ${(status.disk_free_mb / 1000).toFixed(1)} GB free`, ""]);
  fill("sensors", lines);
  if (isLost || (gps && ["closed", "silent", "garbage"].includes(gps.state))) $("more").open = $("more").open || !$("more").dataset.told, $("more").dataset.told = "1";
  const ahead = status.prediction;
  fill("ahead", (ahead?.after_s ?? []).map((s, i) => [`in ${duration(s)}: within ${metres(ahead.r95_m[i])}`, ""]));
  fill("learnt", Object.entries(status.learnt ?? {}).filter(([key, value]) => !key.includes("sigma") && (isNumber(value) || typeof value === "string"))
    .map(([key, value]) => [`${key.replaceAll("_", " ")}: ${isNumber(value) ? Number(value.toPrecision(3)) : value}`, ""]));
}
function fill(id, lines) {
  const list = $(id), told = JSON.stringify(lines);
  if (list.dataset.told === told) return;
  list.dataset.told = told;
  list.replaceChildren(...lines.map(([words, kind, colour]) => {
    const item = document.createElement("li");
    item.className = kind;
    if (colour) {
      const swatch = item.appendChild(document.createElement("i"));
      swatch.style.background = colour;
    }
    item.append(words);
    return item;
  }));
}

// -------------------------------------------------------------------- what is drawn
const ink = () => getComputedStyle(document.documentElement).getPropertyValue("--ink");
const images = new Map();
under.push(() => {   // tiles
  if (!live.tiles) return;
  const world = 2 * Math.PI * view.k;   // pixels
  const [least, most] = live.tiles.zooms;
  const zoomLevel = Math.max(least, Math.min(most, Math.round(Math.log2(world / TILE_PX))));
  const n = 2 ** zoomLevel, size = world / n;
  const column = x => Math.floor((x + Math.PI) / (2 * Math.PI) * n), line = y => Math.floor((Math.PI - y) / (2 * Math.PI) * n);
  const left = column(view.x - width / 2 / view.k), right = column(view.x + width / 2 / view.k);
  const top = Math.max(0, line(view.y + height / 2 / view.k)), bottom = Math.min(n - 1, line(view.y - height / 2 / view.k));
  if ((right - left + 1) * (bottom - top + 1) > 200) return;
  for (let c = left; c <= right; c++) for (let l = top; l <= bottom; l++) {
    const image = tile(`tiles/${zoomLevel}/${((c % n) + n) % n}/${l}`);
    const [x, y] = toScreen({ x: c / n * 2 * Math.PI - Math.PI, y: Math.PI - l / n * 2 * Math.PI });
    if (image.complete && image.naturalWidth) pen.drawImage(image, x, y, size + 0.5, size + 0.5);
  }
});
function tile(address) {
  let image = images.get(address);
  if (!image) {
    image = new Image();
    image.onload = redraw;
    image.src = address;
    images.set(address, image);
    if (images.size > 300) images.delete(images.keys().next().value);
  }
  return image;
}
under.push(() => {   // route
  if (!live.route.length) return;
  pen.beginPath();
  for (const place of live.route) pen.lineTo(...toScreen(place));
  pen.strokeStyle = "#CC79A7"; pen.lineWidth = 8; pen.globalAlpha = 0.5; pen.lineJoin = "round"; pen.stroke(); pen.globalAlpha = 1;
  if (live.route.length > 200) return;
  pen.font = "12px system-ui, sans-serif";
  for (const place of live.route) {
    const [x, y] = toScreen(place);
    pen.beginPath(); pen.arc(x, y, 5, 0, 2 * Math.PI);
    pen.fillStyle = "#CC79A7"; pen.fill();
    pen.fillStyle = ink(); pen.fillText(place.name, x + 9, y + 4);
  }
});
over.push(() => {   // where it will be, and where it is
  const last = points.at(-1);
  if (!last || !live.row) return;
  const ahead = live.status?.away ? null : live.status?.prediction;
  if (ahead) {
    pen.setLineDash([5, 5]); pen.strokeStyle = ink(); pen.lineWidth = 1.5; pen.globalAlpha = 0.6;
    pen.beginPath(); pen.moveTo(...toScreen(last));
    const places = ahead.after_s.map((s, i) => ({ s, ...placeOf(ahead.lat_deg[i], ahead.lon_deg[i]), r95: ahead.r95_m[i] })).filter(p => p.s <= 10);
    for (const place of places) pen.lineTo(...toScreen(place));
    pen.stroke();
    const end = places.at(-1);
    if (end) {
      pen.beginPath(); pen.arc(...toScreen(end), end.r95 / metresPerUnit(end) * view.k, 0, 2 * Math.PI); pen.stroke();
    }
    pen.setLineDash([]); pen.globalAlpha = 1;
  }
  circle(last, 0.16);
  arrow(last);
});
function arrow(place) {
  const [x, y] = toScreen(place);
  pen.save();
  pen.translate(x, y);
  pen.beginPath();
  if (place.course === null) pen.arc(0, 0, 8, 0, 2 * Math.PI);
  else {
    pen.rotate(place.course / 10 * Math.PI / 180);
    pen.moveTo(0, -13); pen.lineTo(9, 10); pen.lineTo(0, 5); pen.lineTo(-9, 10); pen.closePath();
  }
  pen.fillStyle = place.mode[1]; pen.fill();
  pen.lineWidth = 2.5; pen.strokeStyle = "#fff"; pen.stroke();
  pen.restore();
}

// ---------------------------------------------------------------- follow, or not
function centre() {
  const last = points.at(-1);
  if (!last) return;
  const panel = $("legend").getBoundingClientRect(), isWide = width > 600;
  view.x = last.x - (isWide ? panel.right : 0) / 2 / view.k;
  view.y = last.y + (isWide ? 0 : panel.bottom) / 2 / view.k;
}
function follow(isOn) {
  live.isFollowing = isOn;
  $("follow").setAttribute("aria-pressed", String(isOn));
  if (!isOn) return;
  const last = points.at(-1);   // close enough to see the circle and the road
  if (last) view.k = Math.max(view.k, Math.min(width, height) / 2 / (Math.max(150, 3 * last.r95) / metresPerUnit(last)));
  centre();
  redraw();
}
$("follow").onclick = () => follow(!live.isFollowing);
document.addEventListener("keydown", e => { if (e.key === "f") follow(!live.isFollowing); });
canvas.addEventListener("pointermove", e => { if (fingers.has(e.pointerId) && moved > 6) follow(false); });
$("fit").addEventListener("click", () => follow(false));
setInterval(show, 1000);
show();
listen();
