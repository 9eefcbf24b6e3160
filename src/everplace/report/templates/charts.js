// Unpacks plotly, which lies in the page as base64 of gzip, and draws every chart from the data that stands beside it.
async function unpacked(element) {
  const bytes = Uint8Array.from(atob(element.textContent), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}
async function draw(charts) {
  const script = document.createElement("script");
  script.textContent = await unpacked(document.getElementById("plotly"));
  document.head.append(script);
  // The scroll wheel and a finger's drag belong to the page; the mode bar offers zoom to those who want it.
  const touch = window.matchMedia("(pointer: coarse)").matches;
  for (const chart of charts) {
    const { data, layout } = JSON.parse(chart.querySelector("script").textContent);
    Plotly.newPlot(chart.querySelector(".plot"), data, { ...layout, dragmode: touch ? false : "zoom" }, {
      responsive: true,
      displaylogo: false,
      modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
    });
  }
}
const charts = document.querySelectorAll(".chart");
draw(charts).catch(() => {
  for (const chart of charts) {
    chart.querySelector(".plot").textContent = "This browser cannot draw the chart; one of 2023 or later can.";
  }
});
