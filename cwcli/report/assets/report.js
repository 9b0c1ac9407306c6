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

  const draw = async (place) => {
    if (place.dataset.state) { return; }
    place.dataset.state = "drawing";
    const figure = JSON.parse(await unpack(place.dataset.figure));
    const note = place.querySelector(".waiting");
    if (note) { note.remove(); }
    await window.Plotly.newPlot(place, figure.data, withDefaults(figure.layout, place.clientHeight), CONFIG);
    place.dataset.state = "drawn";
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

  const start = async () => {
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
