"use strict";
(() => {
  const INK = "#1a1a1a", GRID = "#e2e2e2";
  const CONFIG = {
    responsive: true, displaylogo: false, showSendToCloud: false, scrollZoom: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
  };
  const AXIS = {
    gridcolor: GRID, zeroline: false, linecolor: "#8a8a8a", showline: true, ticks: "outside", tickcolor: "#8a8a8a",
  };
  const BASE = {
    font: { family: "system-ui, -apple-system, 'Segoe UI', Roboto, 'Liberation Sans', Arial, sans-serif", size: 12,
      color: INK },
    paper_bgcolor: "#fff", plot_bgcolor: "#fff", margin: { l: 74, r: 14, t: 30, b: 44 }, hovermode: "closest",
    legend: { orientation: "h", x: 0, y: -0.16, yanchor: "top" }, showlegend: true,
  };

  const withDefaults = (layout, height) => {
    const full = { ...BASE, ...layout };
    full.legend = { ...BASE.legend, y: -70 / Math.max(200, height - 130) };
    for (const key of Object.keys(full)) {
      if (/^[xy]axis\d*$/.test(key)) { full[key] = { ...AXIS, ...full[key] }; }
    }
    return full;
  };

  const unpack = async (id) => {
    const packed = atob(document.getElementById(id).textContent.trim());
    const bytes = Uint8Array.from(packed, (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };

  const loadLibrary = async () => {
    const script = document.createElement("script");
    script.textContent = await unpack("plotly");
    document.head.append(script);
    if (!window.Plotly) { throw new Error("the plotting library did not start"); }
  };

  // The legend stands below the title of the axis, however little its own height leaves of the plot.
  const seatLegend = async (place) => {
    for (let turn = 0; turn < 3; turn += 1) {
      const y = -56 / Math.max(60, place._fullLayout._size.h);
      if (Math.abs(y - place._fullLayout.legend.y) < 0.01) { return; }
      await window.Plotly.relayout(place, { "legend.y": y });
    }
  };

  // Map tiles below the tracks, where the page names a server of them. East and north are those of the plane that
  // touches WGS84 at the origin; a tile is put where its corners lie on it.
  const MOST_TILES = 64, MOST_ZOOM = 19, EQUATOR_M = 156543.034;
  const DEG = Math.PI / 180, A = 6378137.0, E2 = 0.00669437999014;
  const earth = (lat, lon, alt) => {
    const n = A / Math.sqrt(1 - E2 * Math.sin(lat) ** 2);
    return [(n + alt) * Math.cos(lat) * Math.cos(lon), (n + alt) * Math.cos(lat) * Math.sin(lon),
      (n * (1 - E2) + alt) * Math.sin(lat)];
  };
  const onPlane = (lat0, lon0, alt0) => {
    const zero = earth(lat0, lon0, alt0);
    return (lat, lon) => {
      const d = earth(lat, lon, alt0).map((value, k) => value - zero[k]);
      return [-Math.sin(lon0) * d[0] + Math.cos(lon0) * d[1],
        -Math.sin(lat0) * (Math.cos(lon0) * d[0] + Math.sin(lon0) * d[1]) + Math.cos(lat0) * d[2]];
    };
  };
  const rowOf = (lat, n) => n * (1 - Math.asinh(Math.tan(lat)) / Math.PI) / 2;
  const latOf = (row, n) => Math.atan(Math.sinh(Math.PI * (1 - 2 * row / n)));

  const tile = (place) => {
    const template = document.body.dataset.tiles, origin = (place.dataset.origin || "").split(",").map(Number);
    if (!template || origin.length !== 3 || !origin.every(Number.isFinite) || Math.abs(origin[0]) > 85) { return; }
    const [lat0, lon0, alt0] = [origin[0] * DEG, origin[1] * DEG, origin[2]], at = onPlane(lat0, lon0, alt0);
    const layer = document.createElement("div"), told = document.createElement("span"), known = new Map();
    layer.className = "tiles";
    told.textContent = document.body.dataset.attribution;
    layer.append(told);
    place.prepend(layer);
    const seat = () => {
      const full = place._fullLayout, size = full._size, [x, y] = [full.xaxis, full.yaxis];
      Object.assign(layer.style, { left: size.l + "px", top: size.t + "px", width: size.w + "px", height: size.h + "px" });
      const scale = Math.abs(x.range[1] - x.range[0]) / size.w;
      let zoom = Math.min(MOST_ZOOM, Math.max(0, Math.round(Math.log2(EQUATOR_M * Math.cos(lat0) / scale)))), span;
      for (; zoom >= 0; zoom -= 1) { // the places of the corners are near enough to choose tiles by
        const n = 2 ** zoom, down = (metres) => rowOf(Math.max(-1.48, Math.min(1.48, lat0 + metres / A)), n);
        const across = (metres) => n * (0.5 + (lon0 + metres / (A * Math.cos(lat0))) / (2 * Math.PI));
        span = [Math.floor(across(x.range[0])), Math.floor(across(x.range[1])),
          Math.max(0, Math.floor(down(y.range[1]))), Math.min(n - 1, Math.floor(down(y.range[0])))];
        if ((span[1] - span[0] + 1) * (span[3] - span[2] + 1) <= MOST_TILES) { break; }
      }
      if (zoom < 0) { // where the earth is a point
        for (const image of known.values()) { image.remove(); }
        known.clear();
        return;
      }
      const n = 2 ** zoom, wanted = new Set();
      for (let column = span[0]; column <= span[1]; column += 1) {
        for (let row = span[2]; row <= span[3]; row += 1) {
          const key = [zoom, column, row].join();
          wanted.add(key);
          if (!known.has(key)) {
            const image = document.createElement("img");
            image.alt = "";
            const inWorld = ((column % n) + n) % n;
            image.src = template.replace("{z}", zoom).replace("{x}", inWorld).replace("{y}", row);
            image.addEventListener("error", () => { image.style.visibility = "hidden"; });
            layer.prepend(image);
            known.set(key, image);
          }
          const lons = [column, column + 1].map((each) => (each / n - 0.5) * 2 * Math.PI);
          const [west, north] = at(latOf(row, n), lons[0]), [east, south] = at(latOf(row + 1, n), lons[1]);
          const left = x.d2p(west), top = y.d2p(north);
          Object.assign(known.get(key).style, { left: left + "px", top: top + "px", width: x.d2p(east) - left + 0.5 + "px",
            height: y.d2p(south) - top + 0.5 + "px" });
        }
      }
      for (const [key, image] of known) { if (!wanted.has(key)) { image.remove(); known.delete(key); } }
    };
    seat();
    place.on("plotly_relayout", seat);
    place.on("plotly_relayouting", seat);
    place.on("plotly_afterplot", seat);
  };

  const draw = async (place) => {
    if (place.dataset.state) { return; }
    place.dataset.state = "drawing";
    const figure = JSON.parse(await unpack(place.dataset.figure));
    const note = place.querySelector(".waiting");
    if (note) { note.remove(); }
    const layout = withDefaults(figure.layout, place.clientHeight);
    if (place.dataset.origin && document.body.dataset.tiles) {
      layout.paper_bgcolor = layout.plot_bgcolor = "rgba(0,0,0,0)";
      layout.modebar = { bgcolor: "#fff", color: "rgba(68,68,68,0.3)", activecolor: "rgba(68,68,68,0.7)" };
    }
    await window.Plotly.newPlot(place, figure.data, layout, CONFIG);
    await seatLegend(place);
    tile(place);
    place.dataset.state = "drawn";
    listen(place);
  };

  const places = () => [...document.querySelectorAll(".plot")].filter((place) => !place.closest("details:not([open])"));
  const pause = () => new Promise((done) => setTimeout(done, 0));

  const drawAll = async () => {
    for (const place of places()) {
      await draw(place);
      await pause();
    }
    document.documentElement.dataset.plots = "drawn";
  };

  // One moment in all figures of a log: pointing at a curve, or at a track on the map, marks the same time in the others.
  const OVER_TIME = "time since the log began [s]";

  const isOverTime = (place) => Object.keys(place._fullLayout || {}).some(
    (key) => /^xaxis\d*$/.test(key) && place._fullLayout[key].title && place._fullLayout[key].title.text === OVER_TIME);

  const cursor = (place, kind, index) => {
    const known = place.querySelectorAll(":scope > .cursor." + kind);
    if (known[index]) { return known[index]; }
    const made = document.createElement("div");
    made.className = "cursor " + kind;
    place.append(made);
    return made;
  };

  const between = (times, values, at) => {
    let low = 0, high = times.length - 1;
    if (!times.length || at < times[low] || at > times[high]) { return NaN; }
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= at) { low = middle; } else { high = middle; }
    }
    const part = times[high] > times[low] ? (at - times[low]) / (times[high] - times[low]) : 0;
    return values[low] === null || values[high] === null ? NaN : values[low] + part * (values[high] - values[low]);
  };

  const put = (mark, left, top, size) => {
    const is = Number.isFinite(left) && Number.isFinite(top) && left >= size.l && left <= size.l + size.w &&
      top >= size.t && top <= size.t + size.h;
    mark.style.display = is ? "block" : "none";
    if (is) { mark.style.left = left + "px"; mark.style.top = top + "px"; }
  };

  const markTime = (place, at) => {
    const full = place._fullLayout, size = full._size;
    if (isOverTime(place)) {
      const mark = cursor(place, "at", 0);
      put(mark, size.l + full.xaxis.d2p(at), size.t, size);
      mark.style.height = size.h + "px";
    } else if (place.classList.contains("map")) {
      const tracks = place.data.filter((each) => each.mode === "lines" && Array.isArray(each.customdata));
      tracks.forEach((each, index) => {
        const x = between(each.customdata, each.x, at), y = between(each.customdata, each.y, at);
        put(cursor(place, "here", index), size.l + full.xaxis.d2p(x), size.t + full.yaxis.d2p(y), size);
      });
    }
  };

  const markFrames = (log, at) => {
    const all = [...log.querySelectorAll(".frames figure[data-at]")];
    const far = (each) => Math.abs(Number(each.dataset.at) - at);
    const nearest = all.reduce((best, each) => (!best || far(each) < far(best) ? each : best), null);
    for (const each of all) { each.classList.toggle("now", each === nearest && far(each) < 0.5); }
  };

  // The camera's frame at the moment: the last one before it. Out of sight it comes into the corner while one points.
  const movePlayer = (log, at, from) => {
    const player = log.querySelector(".player");
    if (!player) { return; }
    player.frames = player.frames || JSON.parse(player.querySelector("script").textContent);
    let row = player.frames.findIndex((each) => each[0] > at) - 1;
    if (row === -2) { row = player.frames.length - 1; }
    const [stamp, picture] = player.frames[Math.max(row, 0)], image = player.querySelector("img");
    image.src = "data:image/jpeg;base64," + picture;
    player.dataset.at = stamp;
    player.querySelector("output").textContent = "marked: " + at.toFixed(2) + " s, frame of " + stamp.toFixed(2) + " s";
    const slider = player.querySelector("input"), screen = player.querySelector(".screen");
    if (from !== slider) { slider.value = at; }
    const box = player.getBoundingClientRect();
    const isOut = from !== slider && (box.bottom < 80 || box.top > window.innerHeight - 80);
    if (isOut && !screen.classList.contains("corner")) { player.style.minHeight = box.height + "px"; }
    screen.classList.toggle("corner", isOut);
  };

  const leave = (place) => {
    const screen = (place.closest(".log") || document.body).querySelector(".player .screen");
    if (screen) { screen.classList.remove("corner"); }
  };

  const setTime = (from, at) => {
    const log = from.closest(".log") || document.body;
    for (const place of log.querySelectorAll(".plot[data-state='drawn']")) { markTime(place, at); }
    markFrames(log, at);
    movePlayer(log, at, from);
    log.dataset.at = at.toFixed(2);
  };

  const listen = (place) => {
    place.addEventListener("mouseleave", () => leave(place));
    if (isOverTime(place)) {
      place.addEventListener("mousemove", (event) => {
        const size = place._fullLayout._size;
        const across = event.clientX - place.getBoundingClientRect().left - size.l;
        if (across >= 0 && across <= size.w) { setTime(place, place._fullLayout.xaxis.p2d(across)); }
      });
    } else if (place.classList.contains("map")) {
      place.on("plotly_hover", (event) => {
        const at = event.points[0].customdata;
        if (Number.isFinite(at)) { setTime(place, at); }
      });
    }
  };

  const say = (error) => {
    for (const note of document.querySelectorAll(".waiting")) {
      note.textContent = "The plot can't be shown: this browser lacks what the page needs (" + error.message +
        "). The text and the tables are complete.";
    }
    document.documentElement.dataset.plots = "failed";
  };

  const resize = () => {
    for (const place of places()) {
      if (place.dataset.state === "drawn") { window.Plotly.Plots.resize(place); }
    }
  };

  const open = () => {
    const target = location.hash.length > 1 ? document.getElementById(decodeURIComponent(location.hash.slice(1))) : null;
    const log = target && target.closest("details.log");
    if (log) { log.open = true; target.scrollIntoView(); }
  };

  // The table of all logs: a click on a heading sorts, words find rows that hold them all.
  const sorted = (rows, column, isUp) => {
    const key = (row) => row.cells[column].textContent.trim();
    const value = (row) => (key(row) === "-" ? NaN : Number(key(row)));
    const known = rows.map(key).filter((text) => text !== "-");
    const isNumeric = known.length > 0 && known.every((text) => Number.isFinite(Number(text)));
    const compare = (a, b) => {
      if (!isNumeric) { return key(a).localeCompare(key(b)); }
      const isNone = (row) => Number.isNaN(value(row));
      if (isNone(a) || isNone(b)) { return (isNone(a) - isNone(b)) * (isUp ? 1 : -1); } // what has none comes last
      return value(a) - value(b);
    };
    return [...rows].sort((a, b) => (isUp ? compare(a, b) : compare(b, a)));
  };

  const arrange = (table) => {
    const [head, ...rows] = table.rows;
    let limit = table.tBodies[0].rows.length - 1; // laying out thousands of rows takes seconds
    [...head.cells].forEach((cell, column) => {
      const button = document.createElement("button");
      button.textContent = cell.textContent;
      cell.replaceChildren(button);
      button.addEventListener("click", () => {
        const isUp = cell.getAttribute("aria-sort") !== "ascending";
        for (const each of head.cells) { each.removeAttribute("aria-sort"); }
        cell.setAttribute("aria-sort", isUp ? "ascending" : "descending");
        head.parentNode.append(...sorted([...table.rows].slice(1), column, isUp));
        show();
      });
    });
    const bar = document.createElement("div"), told = document.createElement("output");
    bar.className = "filters";
    const field = (kind, label, more) => {
      const made = document.createElement(kind);
      Object.assign(made, more);
      made.setAttribute("aria-label", label);
      bar.append(made);
      return made;
    };
    const options = (select, words) => {
      for (const [value, text] of words) {
        const made = document.createElement("option");
        made.value = value;
        made.textContent = text;
        select.append(made);
      }
    };
    const find = field("input", "find logs", { type: "search", className: "find", placeholder: `find in ${rows.length} logs` });
    const verdicts = (row) => [...row.querySelectorAll(".badge")].map((each) => each.textContent.trim());
    const verdict = field("select", "only logs with this verdict", { className: "verdict" });
    options(verdict, [["", "any verdict"], ...[...new Set(rows.flatMap(verdicts))].sort().map((each) => [each, each])]);
    const numeric = [...head.cells].map((cell, k) => [k, cell.textContent]).filter(([k]) => head.cells[k].classList.contains("number"));
    const column = field("select", "column of the range", { className: "column" });
    options(column, [["", "any value"], ...numeric]);
    const least = field("input", "least value", { type: "number", step: "any", placeholder: "from", className: "least" });
    const most = field("input", "largest value", { type: "number", step: "any", placeholder: "to", className: "most" });
    const all = field("button", "show all rows", { type: "button" });
    all.addEventListener("click", () => { limit = rows.length; show(); });
    bar.append(told, all);
    const isWithin = (row) => {
      if (!column.value || (least.value === "" && most.value === "")) { return true; }
      const text = row.cells[column.value].textContent.trim(), value = text === "-" ? NaN : Number(text);
      return !(least.value !== "" && !(value >= Number(least.value))) && !(most.value !== "" && !(value <= Number(most.value)));
    };
    const show = () => {
      const words = find.value.toLowerCase().split(/\s+/).filter(Boolean);
      let n = 0;
      for (const row of [...table.rows].slice(1)) {
        row.hidden = !(words.every((word) => row.textContent.toLowerCase().includes(word)) &&
          (!verdict.value || verdicts(row).includes(verdict.value)) && isWithin(row));
        n += !row.hidden;
        row.classList.toggle("beyond", n > limit);
      }
      for (const body of table.tBodies) { body.classList.remove("beyond"); }
      told.textContent = n > limit ? `the first ${limit} of ${n} logs` : n < rows.length ? `${n} of ${rows.length} logs` : "";
      all.textContent = `show all ${n}`;
      all.hidden = n <= limit;
    };
    bar.addEventListener("input", show);
    show();
    table.parentNode.before(bar);
  };

  const start = async () => {
    document.documentElement.dataset.script = "on";
    document.querySelectorAll("table.logs").forEach(arrange);
    for (const slider of document.querySelectorAll(".player input")) {
      slider.addEventListener("input", () => setTime(slider, Number(slider.value)));
    }
    try {
      open();
      if (typeof DecompressionStream === "undefined") { throw new Error("DecompressionStream"); }
      await loadLibrary();
      await drawAll();
      document.addEventListener("toggle", () => drawAll().catch(say), true);
      window.addEventListener("hashchange", open);
      window.addEventListener("beforeprint", () => { document.body.classList.add("printing"); resize(); });
      window.addEventListener("afterprint", () => { document.body.classList.remove("printing"); resize(); });
    } catch (error) {
      say(error);
    }
  };
  start();
})();
