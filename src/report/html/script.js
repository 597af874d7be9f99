"use strict";
for (const viewer of document.querySelectorAll(".viewer")) {
  const keys = ["light", "view", "model", "map"];
  const show = () => {
    const chosen = {};
    for (const input of viewer.querySelectorAll("[data-choice]:checked")) chosen[input.dataset.choice] = input.value;
    for (const element of viewer.querySelectorAll("[data-light], [data-model], [data-map]")) {
      const disagrees = (key) => key in element.dataset && element.dataset[key] !== chosen[key];
      element.classList.toggle("off", keys.some(disagrees));
    }
  };
  viewer.addEventListener("change", (event) => {
    if ("choice" in event.target.dataset) show();
  });
  show();

  const ranges = viewer.querySelectorAll(".compare input");
  const split = (percent) => {
    viewer.style.setProperty("--split", `${percent}%`);
    for (const range of ranges) {
      range.value = percent;
      range.setAttribute("aria-valuetext", `${Math.round(percent)} percent original`);
    }
  };
  for (const range of ranges) {
    range.addEventListener("input", () => split(Number(range.value)));
    const box = range.parentElement;
    const follow = (event) => {
      const { left, width } = box.getBoundingClientRect();
      split(Math.min(100, Math.max(0, (100 * (event.clientX - left)) / width)));
    };
    box.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      box.setPointerCapture(event.pointerId);
      range.focus({ preventScroll: true });
      follow(event);
    });
    box.addEventListener("pointermove", (event) => {
      if (box.hasPointerCapture(event.pointerId)) follow(event);
    });
  }
}
