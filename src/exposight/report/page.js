"use strict";
(() => {
  const config = (place) => ({
    displaylogo: false,
    displayModeBar: "hover",
    responsive: true,
    modeBarButtons: [["toImage",
      place.classList.contains("tall") ? "resetCameraDefault3d" : "resetScale2d"]],
  });

  const read = (id) => JSON.parse(document.getElementById(id).textContent);

  /* Draw every figure from the data that follows it. */
  const drawn = [...document.querySelectorAll(".plot")].map((place) => {
    const figure = read(`${place.id}-figure`);
    return Plotly.newPlot(place, figure.data, figure.layout, config(place));
  });

  /* Paper is narrower than the window. The figures are drawn again at once, at the width of A4
     within its margins: a browser does not wait for what is drawn later. */
  const plots = () => [...document.querySelectorAll(".plot")];
  window.addEventListener("beforeprint", () => {
    plots().forEach((place) => Plotly.relayout(place,
      { autosize: false, width: Math.min(place.clientWidth, 680) }));
  });
  window.addEventListener("afterprint", () => {
    plots().forEach((place) => Plotly.relayout(place, { autosize: true, width: null }));
  });

  /* A menu shows the traces whose meta is its choice, and those without any. */
  for (const menu of document.querySelectorAll("select[data-plot]")) {
    menu.addEventListener("change", () => {
      const place = document.getElementById(menu.dataset.plot);
      const visible = place.data.map((trace) => !trace.meta || trace.meta === menu.value);
      Plotly.restyle(place, { visible });
    });
  }

  /* The slider colours each ring's points by its p_norm at the chosen exposure. */
  const slider = document.getElementById("cloud-slider");
  if (slider) {
    const rings = read("cloud-rings");
    const label = document.getElementById("cloud-exposure");
    const shown = (value, digits) => (value === null ? "not measured" : value.toFixed(digits));
    const recolour = () => {
      const p_norm = rings.p_norm[slider.value];
      const i_avg = rings.i_avg[slider.value];
      const hints = rings.names.map((name, i) =>
        `<b>${name}</b><br>p<sub>norm</sub> ${shown(p_norm[i], 3)}<br>` +
        `i<sub>avg</sub> ${shown(i_avg[i], 1)} (grey level 0–255)`);
      label.textContent = rings.labels[slider.value];
      Plotly.restyle("cloud", {
        "marker.color": [rings.feature.map((i) => p_norm[i])],
        text: [rings.feature.map((i) => hints[i])],
      }, [1]);
    };
    slider.addEventListener("input", recolour);
    Promise.all(drawn).then(recolour);
  }
})();
