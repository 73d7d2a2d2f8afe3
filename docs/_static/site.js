// Long names in tables may break after punctuation and between the words of CamelCase; site.css says on which screens.
function addBreaks() {
  for (const { firstChild: text } of document.querySelectorAll("td code.literal .pre")) {
    const parts = text.data.replace(/[_./:,=-](?=\w\w)|[a-z0-9](?=[A-Z])/g, "$&\n").split("\n");
    text.replaceWith(...parts.flatMap((part, k) => (k ? [document.createElement("wbr"), part] : part)));
  }
}
addEventListener("DOMContentLoaded", addBreaks);

// What scrolls sideways can be reached and scrolled by keyboard.
function reachable() {
  for (const box of document.querySelectorAll(".highlight pre, .table-wrapper")) {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
}
addEventListener("load", reachable);
addEventListener("resize", reachable);

// The search fetches the excerpts of its results, which a browser refuses for files.
if (location.protocol === "file:") DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false;
