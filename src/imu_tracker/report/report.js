// The page scrolls over the map; with Ctrl, or by two fingers, the map zooms.
$("frame").addEventListener("wheel", e => { if (!e.ctrlKey) e.stopPropagation(); }, true);
setTrack(JSON.parse($("data").textContent));
const used = new Set(points.map(p => p.mode));
$("legend").innerHTML = [
  ...data.modes.filter(mode => used.has(mode)).map(([name, colour, title]) => `<i style="background:${colour}"></i>${title}`),
  ...(data.places.length ? [`<i style="background:#cc79a7"></i>noisy for the receiver`] : []),
].join("<br>");
under.push(() => {
  for (const [lat, lon, miss] of data.places) {
    const [x, y] = toScreen(placeOf(lat, lon)), r = Math.max(8, 100 / metresPerUnit({ lat }) * view.k);
    pen.beginPath();
    pen.arc(x, y, r, 0, 2 * Math.PI);
    pen.fillStyle = "#cc79a7";
    pen.globalAlpha = 0.3; pen.fill(); pen.globalAlpha = 1;
  }
});
if (points.length) fit(); else $("frame").className = "empty";
