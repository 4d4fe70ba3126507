"use strict";
// The moment that is shown: cursors in all plots, video, slider and table go together.
(() => {
  const frames = JSON.parse(document.getElementById("frames").textContent);
  const video = document.getElementById("video");
  const slider = document.getElementById("slider");
  const seek = (time) => show(time, true);
  window.report = { seek, time: 0 };
  if (!slider) return;

  const embedded = document.getElementById("video-data");
  if (embedded) {
    const bytes = Uint8Array.from(atob(embedded.textContent.trim()), (letter) => letter.charCodeAt(0));
    video.src = URL.createObjectURL(new Blob([bytes], { type: "video/mp4" }));
    embedded.remove();
  }

  // The last frame that is not after a time.
  const placeOf = (time) => {
    let low = 0;
    let high = frames.time_s.length - 1;
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if (frames.time_s[middle] <= time + 1e-4) low = middle;
      else high = middle - 1;
    }
    return low;
  };

  const cursors = () => {
    const found = [];
    for (const plots of window.Bokeh ? window.Bokeh.documents : []) {
      for (let number = 0; ; number += 1) {
        const cursor = plots.get_model_by_name(`cursor${number}`);
        if (cursor === null) break;
        found.push(cursor);
      }
    }
    return found;
  };

  const number = (value, unit) => (value === null ? "none" : `${value.toFixed(Math.abs(value) < 10 ? 2 : 1)} ${unit}`.trim());

  const row = (cells) => {
    const line = document.createElement("tr");
    for (const text of cells) line.appendChild(document.createElement("td")).textContent = text;
    return line;
  };

  const table = document.querySelector("#readout tbody");
  let shown = -1;

  const show = (time, moves) => {
    const place = placeOf(time);
    window.report.time = frames.time_s[place];
    if (moves && video) video.currentTime = frames.time_s[place] + 1e-3;
    for (const cursor of cursors()) cursor.location = frames.time_s[place];
    if (place === shown) return;
    shown = place;
    slider.value = String(place);
    document.getElementById("place").textContent =
      `frame ${frames.frame[place]}, ${frames.time_s[place].toFixed(2)} s`;
    table.replaceChildren(
      ...frames.members.map((own) =>
        row([
          own.name,
          own.state[place] + (own.switched[place] ? ", switched" : ""),
          number(own.norm[place], own.unit) + (own.norm[place] !== null && !own.certain[place] ? " (gate closed)" : ""),
          number(own.goal[place], own.unit),
          `${Math.round(100 * own.confidence[place])} %`,
        ]),
      ),
    );
  };

  slider.addEventListener("input", () => show(frames.time_s[Number(slider.value)], true));
  for (const button of document.querySelectorAll("button.seek")) {
    button.addEventListener("click", () => {
      const place = frames.frame.indexOf(Number(button.dataset.frame));
      if (place < 0) return;
      show(frames.time_s[place], true);
      document.getElementById("time").scrollIntoView({ behavior: "smooth" });
    });
  }
  if (video) {
    video.addEventListener("seeked", () => show(video.currentTime, false));
    const follow = () => {
      if (!video.paused) show(video.currentTime, false);
      window.requestAnimationFrame(follow);
    };
    follow();
  }
  // The plots are made when the page is complete.
  const start = () => (cursors().length ? show(0, false) : window.setTimeout(start, 50));
  show(0, false);
  start();
})();
