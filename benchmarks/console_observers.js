// What a page's own observers see; injected by benchmarks/console.py before the page's scripts.
window.observed = { fcp: 0, lcp: 0, cls: 0, tbt: 0, frames: 0, changed: null };
const seen = window.observed;
const observe = (type, take) =>
  new PerformanceObserver((list) => list.getEntries().forEach(take)).observe({ type, buffered: true });
observe("paint", (entry) => {
  if (entry.name === "first-contentful-paint") seen.fcp = entry.startTime;
});
observe("largest-contentful-paint", (entry) => {
  seen.lcp = entry.startTime;
});
observe("layout-shift", (entry) => {
  if (!entry.hadRecentInput) seen.cls += entry.value;
});
observe("longtask", (entry) => {
  seen.tbt += Math.max(0, entry.duration - 50);
});
// Frames in which something is drawn on a canvas.
let drawn = false;
const note = (type, names) => {
  for (const name of names) {
    const original = type.prototype[name];
    type.prototype[name] = function (...words) {
      drawn = true;
      return original.apply(this, words);
    };
  }
};
note(WebGL2RenderingContext, ["drawArrays", "drawElements", "drawArraysInstanced", "drawElementsInstanced"]);
note(CanvasRenderingContext2D, ["drawImage", "stroke", "fill", "putImageData"]);
const count = () => {
  if (drawn) seen.frames += 1;
  drawn = false;
  requestAnimationFrame(count);
};
requestAnimationFrame(count);
// When the next frame after the first change of the page is shown.
const watch = () =>
  new MutationObserver(() => {
    if (seen.changed !== null) return;
    seen.changed = 0;
    requestAnimationFrame(() =>
      setTimeout(() => {
        seen.changed = performance.timeOrigin + performance.now();
      }),
    );
  }).observe(document.body, { subtree: true, childList: true, characterData: true, attributes: true });
addEventListener("DOMContentLoaded", watch);
