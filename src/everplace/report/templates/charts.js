// Draws every chart of the page from the data that stands beside it.
for (const chart of document.querySelectorAll(".chart")) {
  const { data, layout } = JSON.parse(chart.querySelector("script").textContent);
  // The scroll wheel and a finger's drag belong to the page; the mode bar offers zoom to those who want it.
  const touch = window.matchMedia("(pointer: coarse)").matches;
  Plotly.newPlot(chart.querySelector(".plot"), data, { ...layout, dragmode: touch ? false : "zoom" }, {
    responsive: true,
    displaylogo: false,
    modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
  });
}
