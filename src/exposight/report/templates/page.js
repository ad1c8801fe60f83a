"use strict";
(() => {
  const config = (place) => ({
    displaylogo: false,
    displayModeBar: "hover",
    responsive: true,
    modeBarButtons: [["toImage",
      place.classList.contains("tall") ? "resetCameraDefault3d" : "resetScale2d"]],
  });

  /* On a narrow window a 3D scene is seen from further away, and its names are small. */
  const isName = (trace) => trace.mode === "text";
  const further = (layout) => layout.meta?.further ?? 1.45;
  const scaled = ({ x, y, z }, by) => ({ x: by * x, y: by * y, z: by * z });
  const narrowed = new Set();
  const narrow = (place, { data, layout }) => {
    if (!layout.scene) return;
    narrowed.add(place);
    layout.font.size = 10;
    data.filter(isName).forEach((trace) => {
      trace.textfont.size = 7.5;
      const names = layout.meta?.names; // those that have room here, too
      if (names) trace.text = trace.text.map((text, i) => (names[i] ? text : ""));
    });
    const { camera } = layout.scene;
    if (!camera) return;
    camera.eye = scaled(camera.eye, further(layout));
    if (camera.center && !layout.meta) camera.center.x -= 0.08; // room for the ticks at the left
  };
  /* What brings a narrow window's scene nearer, or away again. */
  const seen = (place, power) => (narrowed.has(place) && place.layout.scene.camera
    ? { "scene.camera.eye":
      scaled(place.layout.scene.camera.eye, further(place.layout) ** power) } : {});

  /* Draw every figure from the data that follows it. */
  for (const place of document.querySelectorAll("div.plot")) {
    const figure = JSON.parse(document.getElementById(`${place.id}-figure`).textContent);
    if (place.clientWidth < 600) narrow(place, figure);
    Plotly.newPlot(place, figure.data, figure.layout, config(place));
  }

  /* Paper is narrower than the window. The figures are drawn again at once, to fill A4 within
     its margins: a browser does not wait for what is drawn later. (Plotly calls parts of its own
     "plot", too.) */
  const plots = () => [...document.querySelectorAll("div.plot")];
  const heights = { tall: 380 };
  const screen = new Map();
  const size = (place) => {
    const kind = Object.keys(heights).find((own) => place.classList.contains(own));
    return place.closest(".pair") ? { width: 325, height: 300 }
      : { width: 680, height: heights[kind] || 320 };
  };
  window.addEventListener("beforeprint", () => {
    plots().forEach((place) => {
      const named = place.data.findIndex(isName);
      screen.set(place, { font: place.layout.font.size, named,
        name: named < 0 ? null : place.data[named].textfont.size });
      Plotly.relayout(place, { autosize: false, "font.size": 11,
        ...size(place), ...seen(place, -1) });
      if (named >= 0) Plotly.restyle(place, { "textfont.size": 8 }, [named]);
    });
  });
  window.addEventListener("afterprint", () => {
    plots().forEach((place) => {
      const { font, named, name } = screen.get(place);
      Plotly.relayout(place,
        { autosize: true, width: null, height: null, "font.size": font,
          ...seen(place, 1) });
      if (named >= 0) Plotly.restyle(place, { "textfont.size": name }, [named]);
    });
  });

  /* A menu shows the traces whose meta is its choice, and those without any. */
  for (const menu of document.querySelectorAll("select[data-plot]")) {
    menu.addEventListener("change", () => {
      const place = document.getElementById(menu.dataset.plot);
      const visible = place.data.map((trace) => !trace.meta || trace.meta === menu.value);
      Plotly.restyle(place, { visible });
    });
  }
})();
