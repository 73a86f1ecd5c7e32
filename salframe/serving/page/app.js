// The page: queries, answers, routes and sessions.

import { byId, html, percent } from "./elements.js";
import { showObjects } from "./objects.js";
import { Plan } from "./plan.js";
import { openStream, request, requestJson } from "./service.js";

const NUM_PLACES = 5;
let plan = null;
let image = null;
let answer = null;
let session = null; // { id, socket, trail, start, count }

start();

async function start() {
  byId("query").addEventListener("submit", (event) => run(event, localize));
  byId("goal-form").addEventListener("submit", (event) => run(event, () => goTo({ place: byId("goal").value })));
  byId("session-start").addEventListener("click", (event) => run(event, startSession));
  byId("session-end").addEventListener("click", (event) => run(event, endSession));
  for (const id of ["image", "camera"]) byId(id).addEventListener("change", (event) => choose(event.target.files[0]));
  acceptDrops(byId("drop"));
  await run(null, openMap);
}

// Run an action and show its error, if any.
async function run(event, action) {
  event?.preventDefault();
  byId("error").textContent = "";
  try {
    await action();
  } catch (error) {
    byId("status").textContent = "";
    byId("error").textContent = error.message;
  }
}

async function openMap() {
  const map = await (await request("/map")).json();
  const { name, places, frames, method } = map.properties;
  byId("map-summary").textContent = `${name}: ${places} places, ${frames} reference frames, method ${method}`;
  document.title = `${name} - salframe`;
  plan = new Plan(byId("plan"), map, (place) => run(null, () => goTo({ place })), (point) => run(null, () => goTo({ point })));
  const names = map.features.filter((f) => f.properties.layer === "place" || f.properties.layer === "region").map((f) => f.properties.place);
  byId("goal").replaceChildren(...[...new Set(names)].sort().map((place) => html("option", { value: place }, place)));
  for (const id of ["goal-form", "plan-hint"]) byId(id).hidden = !map.properties.has_topology;
  byId("floor-label").hidden = plan.floors.length < 2;
  byId("floor").replaceChildren(...plan.floors.map((z, i) => html("option", { value: i }, `${i + 1} (z = ${z.toFixed(1)} m)`)));
  byId("floor").addEventListener("change", () => { plan.show(Number(byId("floor").value)); redraw(); });
}

function acceptDrops(area) {
  const over = (event, isOver) => { event.preventDefault(); area.classList.toggle("over", isOver); };
  area.addEventListener("dragover", (event) => over(event, true));
  area.addEventListener("dragleave", (event) => over(event, false));
  area.addEventListener("drop", (event) => { over(event, false); choose(event.dataTransfer.files[0]); });
  window.addEventListener("dragover", (event) => event.preventDefault());
  window.addEventListener("drop", (event) => event.preventDefault());
}

// Use a file as the query. An image that is twice as wide as high is used as a panorama.
async function choose(file) {
  if (!file) return;
  image = file;
  let size = "";
  let isPanorama = true;
  try {
    const bitmap = await createImageBitmap(file);
    size = `, ${bitmap.width} x ${bitmap.height}`;
    isPanorama = bitmap.width === 2 * bitmap.height;
    bitmap.close();
  } catch {
    size = ", an image that this browser cannot show";
  }
  byId("chosen").textContent = `${file.name}${size}${isPanorama ? "" : ": a photo"}`;
  byId("fov-row").hidden = isPanorama;
  byId("send").disabled = false;
}

function queryForm() {
  const form = new FormData();
  form.append("image", image, "image");
  const range = byId("range").files[0];
  if (range) {
    form.append("range", range, "range");
    form.append("range_unit_m", byId("unit").value);
    if (byId("kind").value) form.append("range_kind", byId("kind").value);
  }
  if (!byId("fov-row").hidden) form.append("fov_deg", byId("fov").value);
  return form;
}

async function localize() {
  if (image === null) return;
  const form = queryForm();
  let path = "/localize";
  if (session !== null) {
    path = `/sessions/${session.id}/observations`;
    form.append("t_s", ((performance.now() - session.start) / 1000).toFixed(3));
    if (session.count > 0) {
      const motion = { x_m: Number(byId("move-x").value), y_m: Number(byId("move-y").value), yaw_deg: Number(byId("move-yaw").value) };
      form.append("odometry", JSON.stringify(motion));
    }
  }
  byId("status").textContent = "Localizing …";
  byId("send").disabled = true;
  try {
    const content = await (await request(`${path}?objects=true&picture=true`, { method: "POST", body: form })).json();
    if (session !== null) session.count += 1;
    answer = content.answer ?? content;
    showAnswer();
    byId("status").textContent = `Localized in ${answer.seconds.toFixed(2)} s.`;
    byId("answer-title").focus();
  } finally {
    byId("send").disabled = false;
  }
}

function showAnswer() {
  byId("answer").hidden = false;
  byId("verdict").textContent = verdict();
  byId("pose").textContent = poseText();
  byId("places").replaceChildren(...answer.places.slice(0, NUM_PLACES).map(placeRow));
  byId("notes").replaceChildren(...answer.notes.map((note) => html("li", {}, note)));
  showObjects(answer);
  redraw();
}

function redraw() {
  if (answer === null) return;
  plan.shade(answer.places);
  const links = (answer.objects ?? []).filter((thing) => thing.matched).map((thing) => thing.matched.xyz_m);
  plan.showPose(answer.pose, answer.covariance, answer.accepted !== false, links);
  if (session !== null) plan.showTrail(session.trail);
}

function verdict() {
  const best = answer.places[0];
  const outside = answer.out_of_map_probability;
  if (!best || !["ok", "no-pose"].includes(answer.status)) return `Not localized: ${answer.status}.`;
  if (answer.accepted === false) return `Not accepted: the query ${outside > 0.5 ? "is probably" : "may be"} out-of-map (probability ${percent(outside)}).`;
  return `In ${best.place}${best.probability === null ? "" : ` (${percent(best.probability)})`}.`;
}

function poseText() {
  if (answer.pose === null) return answer.heading_deg === null ? "No pose." : `No pose; heading ${answer.heading_deg.toFixed(0)}°.`;
  const { x_m, y_m, yaw_deg } = answer.pose;
  const matrix = answer.covariance?.matrix;
  const error = matrix ? `, standard deviation ${Math.sqrt(matrix[0][0] + matrix[1][1]).toFixed(2)} m` : "";
  return `x ${x_m.toFixed(2)} m, y ${y_m.toFixed(2)} m, heading ${yaw_deg.toFixed(0)}°${error}`;
}

function placeRow(place) {
  const value = place.probability;
  const go = html("button", { type: "button", "aria-label": `Route to ${place.place}` }, "Go there");
  go.addEventListener("click", (event) => run(event, () => goTo({ place: place.place })));
  const parts = [html("span", { class: "name" }, place.place)];
  if (value !== null) {
    parts.push(html("meter", { min: 0, max: 1, value, "aria-label": `Probability of ${place.place}` }), percent(value));
  } else {
    parts.push(`score ${place.score.toPrecision(4)}`);
  }
  if (plan.map.properties.has_topology) parts.push(go);
  return html("li", {}, html("div", { class: "row" }, ...parts));
}

// Show the route from the last answer to a goal: { place } or { point }.
async function goTo(goal) {
  plan.mark(goal.place ?? null);
  if (goal.place) byId("goal").value = goal.place;
  if (answer === null || answer.places.length === 0) {
    byId("status").textContent = "Localize a panorama or a photo first. The route starts at its pose.";
    return;
  }
  const start = answer.pose === null ? { frame: answer.places[0].frame } : { pose: answer.pose };
  const route = await requestJson("/route", { start, goal });
  plan.showRoute(route.line);
  byId("route").hidden = false;
  byId("route-title").textContent = `Route to ${goal.place ?? "the point"}: ${route.length_m.toFixed(1)} m`;
  byId("steps").replaceChildren(...route.steps.map((step) => html("li", {}, step.say)));
  byId("status").textContent = `Route with ${route.steps.length} steps.`;
}

async function startSession() {
  const { id } = await requestJson("/sessions");
  session = { id, trail: [], start: performance.now(), count: 0 };
  session.socket = openStream(id, showBelief, () => { if (session?.id === id) forgetSession("The session has ended."); });
  byId("session-start").hidden = true;
  byId("session-end").hidden = byId("motion").hidden = false;
  byId("session-state").textContent = "With each view, enter the motion since the previous view.";
}

async function endSession() {
  const { id } = session;
  forgetSession("Without a session, each query is independent.");
  await request(`/sessions/${id}`, { method: "DELETE" });
}

function forgetSession(text) {
  const { socket } = session;
  session = null;
  socket.close();
  byId("session-start").hidden = false;
  byId("session-end").hidden = byId("motion").hidden = true;
  byId("session-state").textContent = text;
}

function showBelief(belief) {
  const place = belief.place === null ? "" : ` in ${belief.place}`;
  byId("session-state").textContent = `${belief.status}${place}, ${belief.observations} views`;
  if (belief.pose !== null) {
    session.trail.push([belief.pose.x_m, belief.pose.y_m]);
    plan.showTrail(session.trail);
    plan.showPose(belief.pose, belief.covariance, true);
  }
  plan.shade(belief.places);
}
