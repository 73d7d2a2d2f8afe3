// Says in plain words why the page does not start. This file is no module and in the oldest JavaScript, so that it runs
// in browsers in which the modules do not.
(function () {
  "use strict";

  var local = document.documentElement.hasAttribute("data-game"); // the game runs in the browser, too
  var versions = local ? "Chrome or Edge 92, Firefox 114, Safari 16.4" : "Chrome or Edge 92, Firefox 98, Safari 15.4";
  var OLDEST = "Use " + versions + ", or a newer browser.";
  var names = "WebSocket CanvasRenderingContext2D HTMLDialogElement fetch ResizeObserver URLSearchParams".split(" ");
  if (local) names.push("WebAssembly", "DecompressionStream");
  var missing = names.filter(function (name) { return !window[name]; });
  var shown = false;

  function show(words) {
    if (shown) return; // the first error is the cause of the others
    shown = true;
    if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", write);
    else write();
    function write() {
      var box = document.createElement("div"); // of its own: others write to #lost
      box.id = "unsupported";
      box.className = "lost";
      box.setAttribute("role", "alert");
      box.textContent = words;
      document.body.appendChild(box);
      document.getElementById("state").textContent = "Not started";
    }
  }

  // Errors after the first frame are not the reason why nothing is shown.
  function showError(words) {
    if (!window.pacman || !window.pacman.state.frame) show("The page could not start: " + words + ". " + OLDEST);
  }

  if (!("noModule" in document.createElement("script"))) missing.push("JavaScript modules");
  if (![].at) missing.push("Array.prototype.at");
  if (missing.length) show("This browser cannot show the page, it lacks: " + missing.join(", ") + ". " + OLDEST);
  window.addEventListener("error", function (event) {
    var file = /^(SCRIPT|LINK)$/.test(event.target.tagName) && (event.target.src || event.target.href);
    if (file) show("A file of the page could not be loaded: " + file + " (or a file that it needs). Reload the page.");
    else if (event.error) showError(event.message);
  }, true); // a file's error does not bubble
  window.addEventListener("unhandledrejection", function (event) { showError(String(event.reason)); });
})();
