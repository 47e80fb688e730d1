// The panels beside the drawing: classes of each object, latencies, the daemon's health, and the log. Texts come from other processes, and
// are put in as text only.

const MOST_OBJECTS = 12;
const MOST_BARS = 4;
const MOST_LINES = 60;
const OLD_MS = 5000;
const GONE_MS = 60_000;
const MINUTE_MS = 60_000;

const part = (id) => document.getElementById(id);
const percent = (p) => `${(100 * p).toFixed(p < 0.0995 ? 1 : 0)} %`;
const ms = (us) => `${(us / 1000).toFixed(2)} ms`;

function element(kind, name, ...content) {
  const made = document.createElement(kind);
  if (name) made.className = name;
  made.append(...content);
  return made;
}

function bar(name, probability, kind) {
  const filled = element("i");
  filled.style.width = `${100 * probability}%`;
  return element("div", `bar ${kind}`, element("span", "", name), element("span", "", filled), element("span", "", percent(probability)));
}

const objects = new Map();
const latencies = [];
const counts = [];

/** An answer, as `beo watch --json` prints it. */
export function percept(answer) {
  const now = performance.now();
  latencies.push({ at: now, us: answer.latency_us });
  objects.set(`${answer.producer_id} ${answer.object_id}`, { at: now, answer });
}

/** A status, as `beo status --json` prints it. */
export function status(told) {
  counts.push({ at: performance.now(), answered: told.observations.answered });
  while (counts.length > 2 && performance.now() - counts[0].at > 5000) counts.shift();
  const [first, last] = [counts[0], counts.at(-1)];
  const rate = last.at > first.at ? (1000 * (last.answered - first.answered)) / (last.at - first.at) : 0;
  part("instance").textContent = told.instance;
  health(told.healthy ? "healthy" : (told.complaint ?? "not healthy"), told.healthy ? "good" : "bad");
  const { answered, refused, dropped, overflowed } = told.observations;
  const rows = {
    model: told.model.name,
    grid: told.model.dims.join("×"),
    "answers a second": rate.toFixed(1),
    answered,
    refused,
    "dropped, lost": `${dropped}, ${overflowed}`,
    "its own time, median": ms(told.latency_us.p50),
    "its own time, 99 %": ms(told.latency_us.p99),
  };
  part("daemon").replaceChildren(
    ...Object.entries(rows).map(([name, value]) => element("tr", "", element("td", "", name), element("td", "", String(value)))),
  );
}

/** The state of the daemon or of the connection. */
export function health(word, kind) {
  part("health").textContent = word;
  part("health").className = `badge ${kind}`;
}

let pictures = 0;

/** A picture of a frame. Of those that are decoded at the same time the newest stays. */
export async function picture({ data, format }) {
  const number = ++pictures;
  const decoded = await createImageBitmap(new Blob([data], { type: `image/${format}` }));
  if (number === pictures) {
    const canvas = part("picture");
    part("camera").hidden = false;
    [canvas.width, canvas.height] = [decoded.width, decoded.height];
    canvas.getContext("2d").drawImage(decoded, 0, 0);
  }
  decoded.close();
}

/** A line of the log. */
export function log({ level, message, name }) {
  const line = element("li", level >= 3 ? "warning" : "", `${name}: ${message}`);
  part("lines").prepend(line);
  while (part("lines").childElementCount > MOST_LINES) part("lines").lastChild.remove();
}

function drawObjects(now) {
  for (const [key, { at }] of objects) if (now - at > GONE_MS) objects.delete(key);
  const newest = [...objects.values()].sort((a, b) => b.at - a.at).slice(0, MOST_OBJECTS);
  newest.sort((a, b) => a.answer.object_id - b.answer.object_id);
  if (newest.length === 0) return;
  part("objects").replaceChildren(
    ...newest.map(({ at, answer }) => {
      const ranked = Object.entries(answer.posterior).sort((a, b) => b[1] - a[1]).slice(0, MOST_BARS);
      const bars = ranked.map(([name, p]) => bar(name, p, ""));
      if (answer.none_probability != null) bars.push(bar("none of these", answer.none_probability, "none"));
      const title = element("b", "", answer.class ?? `refused: ${answer.refused}`, " ", element("small", "", `object ${answer.object_id}, ${ms(answer.latency_us)}`));
      return element("div", now - at > OLD_MS ? "object old" : "object", title, ...bars);
    }),
  );
}

function drawLatencies(now) {
  while (latencies.length > 0 && now - latencies[0].at > MINUTE_MS) latencies.shift();
  const canvas = part("latency");
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, canvas.width, canvas.height);
  if (latencies.length === 0) return;
  const sorted = latencies.map(({ us }) => us).sort((a, b) => a - b);
  const quantile = (share) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
  // Rare long ones are drawn at the upper edge.
  const most = Math.min(1.15 * sorted.at(-1), 2 * quantile(0.95));
  context.fillStyle = "#76b7b2";
  for (const { at, us } of latencies) {
    context.fillRect(canvas.width * (1 - (now - at) / MINUTE_MS) - 2, canvas.height * Math.max(0, 1 - us / most) - 2, 4, 4);
  }
  context.fillStyle = "#98a2b0";
  context.font = "20px system-ui, sans-serif";
  context.fillText(ms(most), 6, 22);
  part("latencies").textContent = `${latencies.length} answers: median ${ms(quantile(0.5))}, 99 % ${ms(quantile(0.99))}`;
}

setInterval(() => {
  const now = performance.now();
  drawObjects(now);
  drawLatencies(now);
}, 250);
