// A round in an address: behind its #, as the server writes it, and the tick to look at.

import { notice, question, told } from "./notices.js";
import { state } from "./state.js";

// The address without the token: whoever gets it needs one of his own.
export async function copyLink(link) {
  const address = `${location.origin}${location.pathname}#${link}`;
  const token = new URLSearchParams(location.search).has("token") ? " It contains no token: whoever opens it needs one." : "";
  history.replaceState(null, "", `#${link}`);
  try {
    await navigator.clipboard.writeText(address);
    notice(`Link copied.${token}`);
  } catch {
    notice(`The link is in the address bar.${token}`);
  }
}

function readLink(hash, settings) {
  const words = new URLSearchParams(hash.replace(/^#/, ""));
  if (!words.has("seed")) return null;
  const message = { do: "setup", finish: true, seed: Number(words.get("seed")), settings: {} };
  for (const name of ["map", "preset", "policy", "second"]) if (words.has(name)) message[name] = words.get(name);
  if (words.has("level")) message.level = Number(words.get("level"));
  if (words.has("ghosts")) message.ghosts = words.get("ghosts").split(",");
  if (words.has("clyde")) message.clyde_mps = Number(words.get("clyde"));
  for (const [name, value] of words) if (name.startsWith("set.")) message.settings[name.slice(4)] = settings.read(name.slice(4), value);
  const tick = words.has("tick") ? Number(words.get("tick")) : null;
  return { message, tick: Number.isInteger(tick) ? tick : null };
}

// Brings the round of the address back, plays it to its end, and opens it at its moment.
export async function followLink(hash, connection, settings, stories) {
  const link = readLink(hash, settings);
  if (!link) return;
  const playing = state.frame && state.frame.state !== "menu";
  const someonePlays = Object.values(state.people.roles ?? {}).some(Boolean);
  if ((playing || someonePlays) && !(await question("This link opens another round and ends the current one. Continue?"))) return;
  const message = link.tick === null ? { ...link.message, finish: false } : link.message;
  const waiting = notice("Preparing the round of the link.", { stays: true, key: "setup" });
  const answer = await connection.ask(message, 180000);
  waiting?.();
  if (!told(answer)) return;
  if (answer.data?.story) await stories.open(answer.data.story, link.tick ?? 0);
  else notice("The round of the link is ready: press Start.");
}
