/* A sweep that goes on: how far it is comes as messages, and the page loads itself again for the worlds that are new. */

const shownFar = document.querySelector(".filling output"), shownBar = document.querySelector(".filling progress");
/** It does so no more often than this, and takes a fifth of the time at most [ms]. */
const REST = Math.max(2000, 5 * performance.now()), loadedAt = performance.now();
let wanted = false;

/** Whether nobody is busy with the page: has chosen, typed or marked something. */
const idle = () => !document.querySelector(".query input")?.value && document.activeElement === document.body && getSelection().isCollapsed;

setInterval(() => { if (wanted && idle() && performance.now() - loadedAt > REST) location.reload(); }, 200);

const far = new EventSource("events");
far.addEventListener("far", (event) => {
  const { done, text } = JSON.parse(event.data);
  shownFar.textContent = text;
  wanted = done > shownBar.value || wanted;
});
far.addEventListener("over", () => { wanted = true; });
far.addEventListener("error", () => { shownFar.textContent += " (no connection to the sweep)"; far.close(); });
