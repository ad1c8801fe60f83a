"use strict";
// The live page. All data come from /v1; what is drawn here is drawn from them alone.
const $ = (id) => document.getElementById(id);
const ALIVE = new Set(["starting", "running", "paused", "stopping"]);
const GOES_ON = new Set(["paused", "stopped", "interrupted", "failed"]);
const SCALE = JSON.parse(document.body.dataset.scale);
const dark = matchMedia("(prefers-color-scheme: dark)");
const view = { run: null, state: null, scene: null, capture: null, captures: [], feature: null, curve: null,
  curveView: null, colour: "quality", seq: 0, runs: [], generation: 0, online: true };
window.exposight = view;

// -- small things ----------------------------------------------------------------------------
function make(tag, attributes = {}, ...children) {
  const svg = ["svg", "path", "line", "circle", "text", "g", "polygon", "image", "rect", "title"].includes(tag);
  const node = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value === true ? "" : value);
  }
  node.append(...children.filter((each) => each !== null && each !== ""));
  return node;
}
const counted = (n, noun) => `${n} ${noun}${n === 1 ? "" : "s"}`;
const shown = (value, digits = 2) => (value === null || value === undefined ? "–" : value.toFixed(digits));
const ms = (value) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(4))));
/** Note that something is drawn, for whoever measures or tests the page. */
function mark(name) { performance.mark(name); document.body.dataset[name] = "drawn"; }
function setText(node, text) { if (node.textContent !== text) node.textContent = text; }
function fill(select, items, chosen) {
  const key = JSON.stringify(items);
  if (select.dataset.key !== key) {
    select.dataset.key = key;
    select.replaceChildren(...items.map(([value, text]) => make("option", { value }, text)));
  }
  if (chosen !== null && chosen !== undefined) select.value = String(chosen);
}
function remember() {
  const hash = new URLSearchParams();
  if (view.run) hash.set("run", view.run);
  if (view.feature) hash.set("feature", view.feature);
  history.replaceState(null, "", `#${hash}`);
}

// -- the server ------------------------------------------------------------------------------
class Refused extends Error {
  constructor(status, message) { super(message); this.status = status; }
}
let asking = null;
function askToken(fault) {
  if (asking) return asking;
  asking = new Promise((done) => {
    const dialog = $("token"), form = dialog.querySelector("form");
    setText(form.querySelector(".fault"), fault);
    form.onsubmit = (event) => {
      event.preventDefault();
      sessionStorage.setItem("token", form.elements.token.value.trim());
      form.reset(); dialog.close(); asking = null; done();
    };
    dialog.oncancel = (event) => event.preventDefault();
    dialog.showModal();
  });
  return asking;
}
async function ask(path, { body, method, as = "json", wait = 20000 } = {}) {
  for (;;) {
    const token = sessionStorage.getItem("token"), headers = {};
    if (token) headers.Authorization = `Bearer ${token}`;
    if (body) headers["Content-Type"] = "application/json";
    const answer = await fetch(path, { headers, method: method || (body ? "POST" : "GET"),
      body: body && JSON.stringify(body), signal: AbortSignal.timeout(wait), cache: "no-cache" });
    if (answer.status === 401) { await askToken(token ? "This token is not the server's." : ""); continue; }
    if (answer.ok) return answer[as]();
    let message = `${answer.status} ${answer.statusText}`;
    try { message = (await answer.json()).error || message; } catch { /* not ours */ }
    throw new Refused(answer.status, message);
  }
}
const ofRun = (path) => `/v1/runs/${encodeURIComponent(view.run)}/${path}`;
const inPath = (name) => name.split("/").map(encodeURIComponent).join("/");
function connected(yes) {
  if (yes === view.online) return;
  view.online = yes;
  $("banner").hidden = yes;
  setText($("banner"), yes ? "" : "Connection lost, trying again. What was measured is kept.");
}

let wake = () => {};
const pause = (time) => new Promise((done) => { const timer = setTimeout(done, time);
  wake = () => { clearTimeout(timer); done(); }; });
document.addEventListener("visibilitychange", () => wake());
window.addEventListener("online", () => wake());

/** Follow the chosen run until another one is chosen; what is lost is asked for again. */
async function follow() {
  const mine = ++view.generation;
  let faults = 0, listed = -Infinity;
  while (mine === view.generation) {
    try {
      if (performance.now() - listed > 4000 || !view.run) { await list(); listed = performance.now(); }
      if (mine !== view.generation) return;
      let more = false;
      if (view.run) {
        const { events, state } = await ask(ofRun(`events?after=${view.seq}`));
        if (mine !== view.generation) return;
        more = take(events, state);
      }
      connected(true); faults = 0;
      if (!more) await pause(document.hidden ? 4000 : view.state && ALIVE.has(view.state.state) ? 400 : 2000);
    } catch (fault) {
      if (mine !== view.generation) return;
      if (fault instanceof Refused && fault.status === 404) { listed = -Infinity; view.run = null; }
      else connected(false);
      await pause(Math.min(8000, 500 * 1.6 ** faults++));
    }
  }
}

async function list() {
  view.runs = (await ask("/v1/runs")).runs;
  $("new").hidden = false;
  const first = view.run ? null : view.runs[0];
  fill($("runs"), view.runs.map((each) => [each.name, `${each.name} · ${each.state}`]), view.run || (first && first.name));
  $("runs").parentNode.hidden = view.runs.length === 0;
  if (first) { choose(first.name); return; }
  $("empty").hidden = view.runs.length > 0;
  $("panels").hidden = view.runs.length === 0;
  if (!view.runs.length) await explain();
}

/** Return the names of what runs can be made of. */
async function served() {
  const [plans, models, campaigns] = await Promise.all(["plans", "models", "campaigns"].map((each) => ask(`/v1/${each}`)));
  return { plans: [...plans.exposure_plans, ...plans.measuring_plans], models: models.models.filter((each) => !each.fault).map((each) => each.name),
    campaigns: campaigns.campaigns.map((each) => each.name) };
}
async function explain() {
  const there = await served(), { plans } = there;
  setText($("verdict"), "Nothing has been measured here yet");
  setText($("detail"), plans.length ? "Start a run: it is shown here while it measures." : "");
  const say = plans.length ? [
    make("h2", {}, "Ready to measure"),
    make("p", {}, `The served folder has ${counted(plans.length, "plan")}, ${counted(there.models.length, "set")} of models and ${counted(there.campaigns.length, "campaign")}. Press “New run” to carry a plan out.`),
  ] : [
    make("h2", {}, "The served folder has no plan"),
    make("p", {}, "A run needs a plan, and models that decide while it measures. Train models on a campaign, then plan the views, into this folder:"),
    make("pre", {}, "exposight train campaign -o FOLDER/models\nexposight plan FOLDER/models --views campaign -o FOLDER/plan.json"),
    make("p", {}, "This page notices by itself when they are there."),
  ];
  $("new").disabled = !plans.length;
  $("empty").replaceChildren(...say);
}

function choose(name, feature = null) {
  Object.assign(view, { run: name, state: null, scene: null, capture: null, captures: [], curve: null, curveView: null,
    feature, seq: 0 });
  $("log").replaceChildren(); $("curve").replaceChildren(); $("readout").replaceChildren();
  $("camera").replaceChildren(make("p", { class: "quiet" }, "No capture yet."));
  $("panels").hidden = false; $("empty").hidden = true;
  remember();
  refresh();
  follow();
}

/** Take new events; return whether more of them wait. */
function take(events, state) {
  if (state.last_seq < view.seq) { choose(view.run, view.feature); return false; } // begun anew under the same name
  const before = view.state;
  const news = events.filter((each) => each.seq > view.seq);
  view.state = state;
  if (news.length) {
    log(news);
    view.seq = news[news.length - 1].seq;
    mark("log");
  }
  head();
  const changed = before && (before.state !== state.state || before.n_captures !== state.n_captures);
  if (changed || (before && news.length)) refresh();
  return news.length > 0 && view.seq < state.last_seq;
}

let refreshing = false, again = false;
/** Ask for what is shown of the run, one time after the other. */
async function refresh() {
  if (refreshing) { again = true; return; }
  refreshing = true;
  const mine = view.run;
  try {
    const early = view.feature ? loadCurve() : null;
    if (early) early.catch(() => {}); // the scene's own fault is told
    const scene = await ask(ofRun("scene"));
    if (mine === view.run) {
      view.scene = scene;
      drawScene();
      await (early || loadCurve());
    }
  } catch (fault) { if (!(fault instanceof Refused) && mine === view.run) { connected(false); again = true; await pause(1000); } }
  refreshing = false;
  if (again || mine !== view.run) { again = false; if (view.run) refresh(); }
}

// -- head ------------------------------------------------------------------------------------
function tally() {
  const features = view.scene ? view.scene.features : [];
  const of = (status) => features.filter((each) => each.status === status);
  return { n: features.length, had: of("had"), open: of("open"), failed: [...of("failed"), ...of("unseen")] };
}
function head() {
  const state = view.state;
  if (!state) return;
  $("state").className = state.state;
  setText($("state"), state.state);
  $("pause").hidden = state.state !== "running" && state.state !== "starting";
  $("continue").hidden = !GOES_ON.has(state.state);
  $("stop").hidden = !ALIVE.has(state.state) || state.state === "stopping";
  $("report").hidden = state.n_captures === 0;
  if (!sessionStorage.getItem("token")) $("report").href = ofRun("report");
  const { n, had, open, failed } = tally();
  const captures = counted(state.n_captures, "capture"), known = state.n_had !== null || had.length + failed.length > 0
    || open.some((each) => each.predicted !== null);
  let said = !known ? `${captures} of ${counted(state.n_features, "feature")}`
    : `${n ? had.length : state.n_had} of ${counted(n || state.n_features, "feature")} had, ${captures}`;
  if (open.length && known) said += `, ${open.length} still open`;
  if (failed.length) said += `, ${failed.length} failed`;
  const why = [...failed, ...open].find((each) => each.reason);
  let detail = state.error || (why ? `${why.name}: ${why.reason}` : "");
  if (!detail && state.state === "finished") detail = state.verdict;
  const other = failed.length + open.length - 1;
  if (why && !state.error && failed.length > 1) detail += `; and ${counted(failed.length - 1, "more feature")}`;
  if (!detail && other >= 0 && known) detail = `open: ${open.slice(0, 6).map((each) => each.name).join(", ")}${open.length > 6 ? " …" : ""}`;
  setText($("verdict"), said);
  setText($("detail"), detail);
  setText($("said"), `${view.run} ${state.state}: ${said}`);
  document.title = `${said} · ${view.run}`;
  const option = [...$("runs").options].find((each) => each.value === view.run);
  if (option) setText(option, `${view.run} · ${state.state}`);
}

// -- log -------------------------------------------------------------------------------------
function log(events) {
  const list = $("log");
  for (const event of events) {
    const first = list.firstElementChild;
    if (event.kind === "progress" && first && first.classList.contains("progress")) first.remove();
    list.prepend(entry(event));
  }
  while (list.children.length > 400) list.lastElementChild.remove();
}
function entry({ seq, time, kind, text, data }) {
  const heads = { request: "Decided", decision: `Capture ${1 + (data.number ?? 0)}`, outcomes: "Features", error: "Error",
    progress: "Progress", state: data.state || "State" };
  let says = text;
  if (kind === "decision") says = data.gave || text;
  const item = make("li", { class: kind, "data-seq": seq },
    make("time", { datetime: time }, new Date(time).toLocaleTimeString([], { hour12: false })), make("b", {}, heads[kind] || kind));
  item.append(make("p", {}, says));
  if (data.remark) item.append(make("p", { class: "remark" }, data.remark));
  for (const each of kind === "outcomes" ? data.outcomes || [] : []) {
    if (each.status === "given up" || each.status === "not seen") item.append(make("p", { class: "remark" }, `${each.feature}: ${each.reason}`));
  }
  return item;
}

// -- features, views, progress ---------------------------------------------------------------
function drawScene() {
  const { features } = view.scene;
  if (!features.some((each) => each.name === view.feature)) {
    const best = features.find((each) => each.status === "failed") || features.find((each) => each.status === "open") || features[0];
    view.feature = best ? best.name : null;
    remember();
  }
  findCaptures();
  head(); table(); progress(); chooseCaptures(); drawRings(); drawPart();
}
function table() {
  const body = $("features").tBodies[0], { features } = view.scene;
  while (body.rows.length > features.length) body.lastElementChild.remove();
  features.forEach((each, i) => {
    let row = body.rows[i];
    if (!row) { row = make("tr", {}, make("th", { scope: "row" }), ...Array.from({ length: 4 }, () => make("td"))); body.append(row); }
    row.dataset.name = each.name;
    row.title = each.reason || "";
    const cells = [each.name, each.status, shown(each.p_norm), each.predicted === null ? "–" : `${Math.round(100 * each.predicted)} %`, ms(each.exposure_ms)];
    cells.forEach((text, k) => { setText(row.cells[k], text); row.cells[k].className = k > 1 ? "n" : k === 1 ? each.status : ""; });
  });
  select();
}
function select() {
  for (const row of $("features").tBodies[0].rows) {
    const chosen = row.dataset.name === view.feature;
    row.setAttribute("aria-selected", chosen);
    row.tabIndex = chosen ? 0 : -1;
  }
}
function pick(name, focus = false) {
  if (!name || name === view.feature) return;
  Object.assign(view, { feature: name, curveView: null });
  remember(); select(); drawPart(); drawRings();
  const row = [...$("features").tBodies[0].rows].find((each) => each.dataset.name === name);
  if (row) { row.scrollIntoView({ block: "nearest" }); if (focus) row.focus(); }
  loadCurve().catch(() => {});
}
function progress() {
  const { n, had, open, failed } = tally(), bar = $("bar");
  const part = (kind, count) => { const node = make("i", { class: kind }); node.style.width = `${(100 * count) / Math.max(n, 1)}%`; return node; };
  bar.replaceChildren(part("had", had.length), part("failed", failed.length));
  bar.setAttribute("aria-label", `${had.length} had, ${open.length} open, ${failed.length} failed of ${n}`);
  const count = (kind, k) => make("span", { class: kind }, make("b", {}, String(k)), kind);
  $("counts").replaceChildren(count("had", had.length), count("open", open.length), count("failed", failed.length));
  const planned = view.scene.views.reduce((sum, each) => sum + each.planned_ms.length, 0);
  const taken = view.scene.views.reduce((sum, each) => sum + each.captures.length, 0);
  setText($("captured"), planned ? `${counted(taken, "capture")}, ${planned} planned` : counted(taken, "capture"));
  $("views").replaceChildren(...view.scene.views.map((each) => {
    const near = (a, b) => Math.abs(a - b) < 1e-6 * a;
    const left = each.planned_ms.filter((time) => !each.captures.some((capture) => near(capture.exposure_ms, time)));
    return make("div", { class: "view" }, make("h3", {}, each.name), make("div", { class: "chips" },
      ...each.captures.map((capture) => make("button", { class: "chip", type: "button", "data-capture": capture.number,
        title: "show this capture" }, `✓ ${ms(capture.exposure_ms)} ms`)),
      ...left.map((time) => make("span", { class: "chip", title: view.state && view.state.state === "finished" ? "planned, was not needed" : "planned" }, `${ms(time)} ms`))));
  }));
  mark("progress");
}

// -- camera ----------------------------------------------------------------------------------
let followed = true, imageUrl = null, pictured = null;
function findCaptures() {
  const all = view.scene.views.flatMap((each) => each.captures.map((capture) => ({ ...capture, view: each.name })));
  view.captures = all.sort((a, b) => a.number - b.number);
  if (!all.length) return;
  if (followed || !all.some((each) => each.number === view.capture)) view.capture = all[all.length - 1].number;
  loadImage().catch(() => {});
}
function chooseCaptures() {
  const items = view.captures.map((each) => [String(each.number), `${each.number + 1} · ${each.view} · ${ms(each.exposure_ms)} ms`]);
  fill($("captures"), items.reverse(), view.capture);
  $("captures").hidden = !items.length;
}
async function loadImage() {
  const key = `${view.run}/${view.capture}`;
  if (pictured && pictured.key === key) return;
  const place = `/v1/campaigns/${inPath(`runs/${view.run}/campaign`)}/captures/${view.capture}`;
  const [blob, rings] = await Promise.all([ask(`${place}/image?width=960`, { as: "blob" }), ask(`${place}/rings`)]);
  if (key !== `${view.run}/${view.capture}`) return;
  if (imageUrl) URL.revokeObjectURL(imageUrl);
  imageUrl = URL.createObjectURL(blob);
  pictured = { key, rings };
  const capture = view.captures.find((each) => each.number === view.capture);
  const svg = make("svg", { viewBox: `0 0 ${rings.width} ${rings.height}`, role: "img",
    "aria-label": `Image of view ${capture.view} at ${ms(capture.exposure_ms)} ms with the outlines of ${rings.rings.length} features` });
  svg.style.aspectRatio = `${rings.width} / ${rings.height}`;
  svg.append(make("image", { href: imageUrl, width: rings.width, height: rings.height, preserveAspectRatio: "none" }), make("g"));
  svg.firstChild.addEventListener("load", () => mark("image"), { once: true });
  $("camera").replaceChildren(svg);
  drawRings();
}
function drawRings() {
  const group = $("camera").querySelector("g");
  if (!group || !pictured) return;
  const known = new Map((view.scene ? view.scene.features : []).map((each) => [each.name, each]));
  const { width, rings } = pictured.rings;
  group.replaceChildren(...rings.filter((each) => each.outline.length).flatMap((each) => {
    const now = known.get(each.feature), status = now ? now.status : each.status;
    const low = each.p_norm !== null && view.scene && each.p_norm < view.scene.need;
    const chosen = each.feature === view.feature;
    const points = each.outline.map(([u, v]) => `${u.toFixed(1)},${v.toFixed(1)}`).join(" ");
    const outline = make("polygon", { class: `ring ${status}${low ? " below" : ""}`, "data-feature": each.feature, points },
    make("title", {}, `${each.feature}: ${each.p_norm === null ? "not measured here" : `p_norm ${shown(each.p_norm)} here`}, ${status}`));
    if (!chosen) return [outline];
    const u = each.outline.reduce((sum, point) => sum + point[0], 0) / each.outline.length;
    const v = Math.min(...each.outline.map((point) => point[1]));
    const name = make("text", { class: "ring-name", x: u, y: v - width / 120, "font-size": width / 36 }, each.feature);
    return [make("polygon", { class: "halo", points }), outline, name];
  }));
}

// -- curve -----------------------------------------------------------------------------------
async function loadCurve() {
  if (!view.feature) return;
  const { run, feature } = view, of = view.curveView ? `&view=${encodeURIComponent(view.curveView)}` : "";
  try {
    const curve = await ask(ofRun(`curve?feature=${encodeURIComponent(feature)}${of}`));
    if (run !== view.run || feature !== view.feature) return;
    view.curve = curve;
    drawCurve();
  } catch (fault) {
    if (!(fault instanceof Refused)) throw fault;
    $("curve").replaceChildren(make("p", { class: "quiet" }, fault.message));
  }
}
function ticks(low, high) {
  const steps = [];
  for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++) {
    for (const factor of [1, 2, 5]) { const t = factor * 10 ** power; if (t >= low * 0.999 && t <= high * 1.001) steps.push(t); }
  }
  return steps;
}
function drawCurve() {
  const curve = view.curve, box = $("curve");
  if (!curve) return;
  setText($("curve-title"), curve.view ? `${curve.feature}: p_norm over exposure time` : curve.feature);
  fill($("curve-view"), curve.views.map((each) => [each, each]), curve.view);
  $("curve-view").hidden = curve.views.length < 2;
  const times = [...curve.exposure_ms, ...curve.chosen_ms, ...curve.measured.map((each) => each.exposure_ms)];
  if (!times.length) {
    box.replaceChildren(make("p", { class: "quiet" }, "No view of the plan sees this feature, and no capture measured it."));
    $("readout").replaceChildren(); mark("curve"); return;
  }
  const W = Math.max(box.clientWidth, 200), H = Math.max(box.clientHeight, 120), left = 36, right = 10, top = 8, bottom = 34;
  let low = Math.min(...times), high = Math.max(...times);
  if (high / low < 1.5) { low /= 1.5; high *= 1.5; }
  const most = Math.max(1, ...curve.high, ...curve.measured.map((each) => each.p_norm)) * 1.04;
  const x = (t) => left + ((W - left - right) * Math.log(t / low)) / Math.log(high / low);
  const y = (p) => top + (H - top - bottom) * (1 - Math.max(0, p) / most);
  const line = (values) => values.map((p, i) => `${i ? "L" : "M"}${x(curve.exposure_ms[i]).toFixed(1)},${y(p).toFixed(1)}`).join("");
  const svg = make("svg", { viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": described(curve) });
  for (const p of [0, 0.25, 0.5, 0.75, 1]) {
    svg.append(make("line", { class: p ? "grid" : "axis", x1: left, x2: W - right, y1: y(p), y2: y(p) }),
      make("text", { x: left - 6, y: y(p) + 4, "text-anchor": "end" }, String(p)));
  }
  let free = -Infinity;
  for (const t of ticks(low, high)) {
    svg.append(make("line", { class: "axis", x1: x(t), x2: x(t), y1: y(0), y2: y(0) + 4 }));
    if (x(t) - free > 34) { svg.append(make("text", { x: x(t), y: y(0) + 17, "text-anchor": "middle" }, ms(t))); free = x(t); }
  }
  svg.append(make("text", { x: W - right, y: H - 2, "text-anchor": "end" }, "exposure time, ms"));
  if (curve.exposure_ms.length) {
    const back = curve.low.map((p, i) => `L${x(curve.exposure_ms[i]).toFixed(1)},${y(p).toFixed(1)}`).reverse().join("");
    svg.append(make("path", { class: "band", d: `${line(curve.high)}${back}Z` }));
    if (curve.corrected) svg.append(make("path", { class: "before", d: line(curve.before) }));
    svg.append(make("path", { class: "mean", d: line(curve.p_norm) }));
  }
  svg.append(make("line", { class: "need", x1: left, x2: W - right, y1: y(curve.need), y2: y(curve.need) }),
    make("text", { class: "need-name", x: W - right, y: y(curve.need) - 5, "text-anchor": "end" }, `needed ${shown(curve.need)}`));
  for (const t of curve.chosen_ms) svg.append(make("line", { class: "chosen", x1: x(t), x2: x(t), y1: top, y2: y(0) }));
  for (const each of curve.measured) {
    svg.append(make("circle", { class: "point", cx: x(each.exposure_ms), cy: y(each.p_norm), r: 5 },
      make("title", {}, `measured ${shown(each.p_norm)} at ${ms(each.exposure_ms)} ms`)));
  }
  const hair = make("line", { class: "hover", y1: top, y2: y(0), visibility: "hidden" });
  svg.append(hair);
  svg.addEventListener("pointermove", (event) => hover(event, curve, hair, x));
  svg.addEventListener("pointerleave", () => { hair.setAttribute("visibility", "hidden"); keys(curve); });
  box.replaceChildren(svg);
  keys(curve);
  mark("curve");
}
function described(curve) {
  const measured = curve.measured.map((each) => `${shown(each.p_norm)} at ${ms(each.exposure_ms)} ms`).join(", ");
  return `${curve.feature} in ${curve.view}: needed ${shown(curve.need)}; measured ${measured || "nothing yet"}; planned at ${curve.chosen_ms.map(ms).join(", ") || "no time"} ms`;
}
function keys(curve) {
  const key = (kind, text) => make("span", { class: `key ${kind}` }, text);
  $("readout").replaceChildren(...(curve.exposure_ms.length ? [key("", curve.corrected ? "corrected forecast, 2σ" : "forecast, 2σ")] : []),
    ...(curve.corrected ? [key("before", "from the pose alone")] : []), ...(curve.chosen_ms.length ? [key("chosen", "planned")] : []),
    ...(curve.measured.length ? [key("point", "measured")] : []));
}
function hover(event, curve, hair, x) {
  if (!curve.exposure_ms.length) return;
  const at = event.offsetX;
  let i = 0;
  curve.exposure_ms.forEach((t, k) => { if (Math.abs(x(t) - at) < Math.abs(x(curve.exposure_ms[i]) - at)) i = k; });
  const place = x(curve.exposure_ms[i]);
  hair.setAttribute("x1", place); hair.setAttribute("x2", place); hair.setAttribute("visibility", "visible");
  $("readout").textContent = `${ms(curve.exposure_ms[i])} ms: p_norm ${shown(curve.p_norm[i])} expected, ${shown(curve.low[i])} to ${shown(curve.high[i])} (2σ)`;
}

// -- the part in 3D --------------------------------------------------------------------------
const CORNERS = 24;
let plotly = null, plotting = false, pending = false;
/** Run plotly.js, which takes a second, when all else is drawn or has had the time; try again where it failed. */
async function loadPlotly() {
  const others = ["image", "curve", "progress", "log"], late = performance.now() + 1000;
  while (!window.Plotly && performance.now() < late && !others.every((name) => document.body.dataset[name])) await new Promise((done) => setTimeout(done, 20));
  plotly ??= new Promise((done, failed) => {
    const script = make("script", { src: $("plotly").href });
    script.onload = () => done();
    script.onerror = () => { script.remove(); plotly = null; failed(new Error("plotly.js could not be loaded")); };
    document.head.append(script);
  });
  return plotly;
}
async function drawPart() {
  if (plotting) { pending = true; return; }
  const features = view.scene.features.filter((each) => each.position_mm);
  if (!features.length) { $("no-part").hidden = false; return; }
  $("no-part").hidden = true;
  const [data, layout] = figure(features);
  if (!$("part").dataset.drawn) { drawStill(data, layout.scene); mark("part"); }
  plotting = true;
  try {
    await loadPlotly();
    await new Promise((done) => { if (document.hidden) done(); else requestAnimationFrame(() => setTimeout(done)); });
    await Plotly.react($("part"), data, layout, { displayModeBar: false, responsive: true, plotGlPixelRatio: 1, scrollZoom: false });
    if (!$("part").dataset.drawn) {
      $("part").dataset.drawn = "yes";
      $("part").on("plotly_click", ({ points: [point] }) => pick(point.customdata));
    }
    await new Promise((done) => { if (document.hidden) done(); else requestAnimationFrame(done); });
    $("still").hidden = true;
    mark("turnable");
  } catch (fault) {
    setText($("no-part"), `The part cannot be turned here: ${fault.message}.`);
    $("no-part").hidden = false;
  }
  plotting = false;
  if (pending) { pending = false; drawPart(); }
}
/** Draw the part as plotly.js will, far triangles first: while that loads, and where there is no WebGL. */
function drawStill(data, { camera, aspectratio, ...axes }) {
  const canvas = $("still"), { clientWidth: w, clientHeight: h } = $("part"), sharp = window.devicePixelRatio || 1;
  const pen = canvas.getContext("2d"), focal = h / 2 / Math.tan(Math.PI / 8); // plotly.js' 45° from bottom to top
  const eye = ["x", "y", "z"].map((axis) => camera.eye[axis]), ahead = unit(eye.map((each) => -each)), right = unit(cross(ahead, [0, 0, 1])), up = cross(right, ahead);
  const scaled = ["x", "y", "z"].map((axis, d) => { const [low, high] = axes[`${axis}axis`].range; return (value) => ((value - low) / (high - low) - 0.5) * aspectratio[axis] - eye[d]; });
  const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2], triangles = [];
  for (const { x, y, z, i, j, k, intensity, colorscale, vertexcolor } of data) {
    const ends = colorscale && colorscale.map(([, each]) => rgb(each));
    const seen = x.map((_, n) => { const at = [x[n], y[n], z[n]].map((value, d) => scaled[d](value)), depth = dot(at, ahead); return [w / 2 + (focal * dot(at, right)) / depth, h / 2 - (focal * dot(at, up)) / depth, depth]; });
    i.forEach((first, n) => {
      const corners = [first, j[n], k[n]], shade = ends && corners.reduce((sum, each) => sum + intensity[each], 0) / 3;
      const colour = ends ? ends[0].map((low, d) => low + shade * (ends[1][d] - low)) : vertexcolor[first];
      triangles.push([corners.map((each) => seen[each]), `rgb(${colour.map(Math.round).join()})`]);
    });
  }
  [canvas.width, canvas.height] = [w * sharp, h * sharp];
  pen.scale(sharp, sharp);
  const depth = ([corners]) => corners[0][2] + corners[1][2] + corners[2][2];
  for (const [[a, b, c], colour] of triangles.sort((p, q) => depth(q) - depth(p))) {
    pen.fillStyle = pen.strokeStyle = colour;
    pen.lineWidth = 0.7; // over the seams
    pen.beginPath(); pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); pen.lineTo(c[0], c[1]); pen.closePath(); pen.fill(); pen.stroke();
  }
  canvas.hidden = false;
}
/** Right, away and up of the picture in the part's frame: as the first view sees it, but upright. */
function directions(features, views) {
  const n = unit([0, 1, 2].map((d) => features.reduce((sum, each) => sum + each.normal[d], 0)));
  const posed = views.find((each) => each.up), seen = posed ? posed.up : [0, 0, 1];
  const upright = seen.map((value, d) => Math.abs(value) * (1 - Math.abs(n[d])));
  const d = upright.indexOf(Math.max(...upright)), axis = [0, 0, 0];
  axis[d] = Math.sign(seen[d]) || 1;
  const right = unit(cross(axis, n));
  return [right, n.map((value) => -value), cross(n, right)];
}
const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
const unit = (p) => { const length = Math.hypot(...p) || 1; return p.map((each) => each / length); };
const plain = (text) => text.replace(/[&<>]/g, (sign) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[sign]);
const rgb = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
function onScale(value) {
  const at = Math.min(1, Math.max(0, value)) * (SCALE.length - 1), i = Math.min(Math.floor(at), SCALE.length - 2);
  const low = rgb(SCALE[i]), high = rgb(SCALE[i + 1]);
  return low.map((each, k) => Math.round(each + (at - i) * (high[k] - each)));
}

/** One mesh of all marks: a band round each feature, wide where p_norm was measured and narrow where
 * it is planned, a cross on what failed, a dot on what is open, a further band round the chosen one. */
function marks(features, extent, colours) {
  const out = { x: [], y: [], z: [], i: [], j: [], k: [], vertexcolor: [], customdata: [], text: [] };
  for (const each of features) {
    const measured = view.colour === "quality" && each.p_norm !== null, value = measured ? each.p_norm : each.predicted;
    const helper = Math.abs(each.normal[0]) < 0.7 ? [1, 0, 0] : [0, 1, 0], a = unit(cross(each.normal, helper)), b = cross(each.normal, a);
    const reason = each.reason && each.status !== "had" ? `<br>${plain(each.reason).replace(/(.{45}\S*) /g, "$1<br>")}` : "";
    const says = measured ? `p_norm ${shown(value)} at ${ms(each.exposure_ms)} ms` : value === null ? "not planned" : `planned chance ${Math.round(100 * value)} %`;
    const hint = `<b>${plain(each.name)}</b>, ${each.status}<br>${says}${reason}`;
    const add = (u, v, lift, colour) => {
      ["x", "y", "z"].forEach((axis, d) => out[axis].push(each.position_mm[d] + u * a[d] + v * b[d] + lift * extent * each.normal[d]));
      out.vertexcolor.push(colour); out.customdata.push(each.name); out.text.push(hint);
      return out.x.length - 1;
    };
    const triangle = (i, j, k) => { out.i.push(i); out.j.push(j); out.k.push(k); };
    const band = (inner, outer, lift, colour) => {
      const first = out.x.length;
      for (let c = 0; c < CORNERS; c++) {
        const cos = Math.cos((2 * Math.PI * c) / CORNERS), sin = Math.sin((2 * Math.PI * c) / CORNERS);
        add(inner * cos, inner * sin, lift, colour); add(outer * cos, outer * sin, lift, colour);
      }
      for (let c = 0; c < CORNERS; c++) {
        const here = first + 2 * c, next = first + 2 * ((c + 1) % CORNERS);
        triangle(here, here + 1, next); triangle(here + 1, next + 1, next);
      }
    };
    const r = each.radius_mm, grey = rgb(colours.muted);
    band(r + 0.002 * extent, r + (measured ? 0.018 : 0.009) * extent, 0.006, value === null ? grey : onScale(value));
    if (each.name === view.feature) band(r + 0.022 * extent, r + 0.029 * extent, 0.007, rgb(colours.ink));
    const w = 0.004 * extent, l = 0.016 * extent, line = rgb(each.status === "open" ? colours.accent : colours.bad);
    if (each.status === "open") band(0, 0.8 * w, 0.008, line);
    if (each.status === "failed" || each.status === "unseen") {
      for (const s of [1, -1]) {
        const [p, q, t, o] = [[-l, -l - w], [-l, -l + w], [l, l + w], [l, l - w]].map(([u, v]) => add(u, s * v, 0.01, line));
        triangle(p, q, t); triangle(p, t, o);
      }
    }
  }
  return out;
}
function figure(features) {
  const { mesh, views } = view.scene, turn = directions(features, views);
  const style = getComputedStyle(document.documentElement);
  const colours = Object.fromEntries(["ink", "muted", "accent", "bad", "paper", "rule"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
  if (colours.paper.length === 4) colours.paper = "#ffffff";
  const lighting = { ambient: 1, diffuse: 0, specular: 0, fresnel: 0 }, data = [], column = (d, from) => from.filter((_, i) => i % 3 === d);
  const turned = ({ x, y, z, ...rest }) => {
    const [tx, ty, tz] = turn.map((way) => x.map((value, i) => way[0] * value + way[1] * y[i] + way[2] * z[i]));
    return { x: tx, y: ty, z: tz, ...rest };
  };
  if (mesh) {
    const points = turned({ x: column(0, mesh.vertices), y: column(1, mesh.vertices), z: column(2, mesh.vertices) });
    data.push({ type: "mesh3d", ...points, i: column(0, mesh.triangles), j: column(1, mesh.triangles), k: column(2, mesh.triangles),
      intensity: mesh.shade, cmin: 0, cmax: 1, showscale: false, hoverinfo: "skip", lighting,
      colorscale: dark.matches ? [[0, "#232b33"], [1, "#6b7783"]] : [[0, "#7d858e"], [1, "#f0f2f4"]] });
  }
  const rough = mesh ? data[0] : turned({ x: features.map((each) => each.position_mm[0]), y: features.map((each) => each.position_mm[1]), z: features.map((each) => each.position_mm[2]) });
  const edges = ["x", "y", "z"].map((axis) => [Math.min(...rough[axis]), Math.max(...rough[axis])]);
  const most = Math.max(...features.map((each) => each.radius_mm)), extent = Math.max(...edges.map(([low, high]) => high - low)) + 2 * most;
  data.push({ type: "mesh3d", ...turned(marks(features, extent, colours)), lighting, hovertemplate: "%{text}<extra></extra>" });
  const grow = mesh ? 0.01 * extent : 2 * most + 0.04 * extent, size = edges.map(([low, high]) => (high - low + 2 * grow) / extent);
  // Of invisible axes plotly.js would still make the letters x, y and z out of triangles, for half a second.
  const empty = { title: { text: "" }, showticklabels: false, showgrid: false, showline: false, zeroline: false, showspikes: false,
    showbackground: false, ticks: "", tickmode: "array", tickvals: [] };
  const [xaxis, yaxis, zaxis] = edges.map(([low, high]) => ({ ...empty, range: [low - grow, high + grow] }));
  const chosen = features.find((each) => each.name === view.feature), annotations = [];
  if (chosen) {
    const [x, y, z] = turn.map((way) => way.reduce((sum, value, d) => sum + value * (chosen.position_mm[d] + 0.01 * extent * chosen.normal[d]), 0));
    annotations.push({ x, y, z, text: `<b>${plain(chosen.name)}</b>`, ax: 0, ay: -36, font: { color: colours.ink, size: 13 }, bgcolor: colours.paper,
      bordercolor: colours.rule, borderpad: 3, arrowcolor: colours.rule, arrowwidth: 1, arrowhead: 0 });
  }
  const box = $("part"), away = 0.8 * Math.max(1, (1.7 * box.clientHeight * size[0]) / box.clientWidth, 1.35 * size[2]);
  const layout = { margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: "rgba(0,0,0,0)", showlegend: false, uirevision: view.run,
    hoverlabel: { bgcolor: colours.paper, bordercolor: colours.rule, font: { color: colours.ink, size: 13 } },
    scene: { xaxis, yaxis, zaxis, annotations, aspectmode: "manual", aspectratio: { x: size[0], y: size[1], z: size[2] }, dragmode: "turntable",
      camera: { eye: { x: -0.25 * away, y: -1.02 * away, z: 0.26 * away }, center: { x: 0, y: 0, z: 0 } } } };
  return [data, layout];
}

// -- what people do --------------------------------------------------------------------------
async function order(what) {
  try { view.state = await ask(ofRun(what), { method: "POST" }); head(); }
  catch (fault) { setText($("detail"), fault.message); }
  wake();
}
for (const what of ["pause", "continue", "stop"]) $(what).addEventListener("click", () => order(what));
$("report").addEventListener("click", async (event) => {
  if (!sessionStorage.getItem("token")) return; // a plain link
  event.preventDefault();
  try {
    const url = URL.createObjectURL(await ask(ofRun("report"), { as: "blob", wait: 120000 }));
    make("a", { href: url, download: `${view.run}-report.html` }).click();
    setTimeout(() => URL.revokeObjectURL(url), 60000);
  } catch (fault) { setText($("detail"), fault.message); }
});
$("runs").addEventListener("change", () => { followed = true; choose($("runs").value); });
$("captures").addEventListener("change", () => showCapture(Number($("captures").value)));
function showCapture(number) {
  view.capture = number;
  followed = view.captures.length > 0 && number === view.captures[view.captures.length - 1].number;
  chooseCaptures();
  loadImage().catch(() => {});
}
$("views").addEventListener("click", ({ target }) => { if (target.dataset.capture) showCapture(Number(target.dataset.capture)); });
$("curve-view").addEventListener("change", () => { view.curveView = $("curve-view").value; loadCurve().catch(() => {}); });
$("camera").addEventListener("click", ({ target }) => pick(target.dataset && target.dataset.feature));
$("features").addEventListener("click", ({ target }) => { const row = target.closest("tbody tr"); if (row) pick(row.dataset.name, true); });
$("features").addEventListener("keydown", (event) => {
  const rows = [...$("features").tBodies[0].rows], at = rows.findIndex((row) => row.dataset.name === view.feature);
  const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: rows.length - 1 }[event.key];
  if (to === undefined) return;
  event.preventDefault();
  if (rows[to]) pick(rows[to].dataset.name, true);
});
for (const button of document.querySelectorAll("[data-colour]")) {
  button.addEventListener("click", () => {
    view.colour = button.dataset.colour;
    for (const each of document.querySelectorAll("[data-colour]")) each.setAttribute("aria-pressed", each === button);
    setText($("legend"), view.colour === "quality" ? "wide rings: measured p_norm; narrow rings: planned chance" : "the plan's chance of each feature");
    if (view.scene) drawPart();
  });
}
dark.addEventListener("change", () => { if (view.scene) drawPart(); });
new ResizeObserver(() => drawCurve()).observe($("curve"));

const form = $("start").querySelector("form");
function kinds() { for (const each of form.querySelectorAll("[data-for]")) each.hidden = !each.dataset.for.split(" ").includes(form.elements.kind.value); }
form.elements.kind.addEventListener("change", kinds);
form.querySelector("[value=cancel]").addEventListener("click", () => $("start").close());
$("new").addEventListener("click", async () => {
  setText(form.querySelector(".fault"), "");
  try {
    const there = await served(), named = (names) => names.map((name) => [name, name]);
    fill(form.elements.plan, named(there.plans));
    fill(form.elements.models, [...named(there.models), ["", "none: take the plan's captures as they are"]]);
    fill(form.elements.recording, named(there.campaigns));
    form.elements.kind.options[1].disabled = !there.campaigns.length;
    const taken = new Set(view.runs.map((each) => each.name));
    let n = 1;
    while (taken.has(`run-${n}`)) n++;
    form.elements.name.value = `run-${n}`;
    kinds();
    $("start").showModal();
    form.elements.name.select();
  } catch (fault) { setText($("detail"), fault.message); }
});
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const { name, plan, models, kind, recording, cell, lamp, rings, clouds } = form.elements;
  const driver = { kind: kind.value, ...({ replay: { recording: recording.value }, simulated: { rings_only: rings.checked } }[kind.value] || { cell: cell.value }) };
  if (driver.kind === "simulated" && lamp.value) driver.lamp_power = Number(lamp.value);
  const closed = plan.value.toLowerCase().endsWith(".json");
  try {
    const state = await ask("/v1/runs", { body: { name: name.value, plan: plan.value, models: (closed && models.value) || null, driver, clouds: clouds.checked } });
    $("start").close();
    followed = true;
    await list();
    choose(state.name);
  } catch (fault) { setText(form.querySelector(".fault"), fault.message); }
});
window.addEventListener("hashchange", begin);
function begin() {
  const hash = new URLSearchParams(location.hash.slice(1));
  if (hash.get("run") && hash.get("run") !== view.run) choose(hash.get("run"), hash.get("feature"));
  else if (!view.run) follow();
}
const bar = SCALE.map((each, i) => `${each} ${(100 * i) / (SCALE.length - 1)}%`).join(",");
$("scale").style.background = `linear-gradient(90deg, ${bar})`;
begin();
