// The page of the API: each operation of openapi.json, with an example that sends a request.

import { byId, html } from "./elements.js";
import { request } from "./service.js";

const MAX_SHOWN = 4000;
let lastSession = "";

try {
  const schema = await (await request("/openapi.json")).json();
  for (const [path, methods] of Object.entries(schema.paths)) {
    for (const [method, operation] of Object.entries(methods)) {
      byId("operations").append(section(path, method.toUpperCase(), operation));
    }
  }
} catch (error) {
  byId("error").textContent = error.message;
}

function section(path, method, operation) {
  const title = html("h2", {}, html("code", {}, `${method} ${path}`));
  const parts = [title, html("p", {}, operation.description ?? operation.summary)];
  const form = html("form", {});
  const inputs = {};
  for (const parameter of operation.parameters ?? []) {
    const isFlag = parameter.schema.type === "boolean";
    const input = html("input", { type: isFlag ? "checkbox" : "text", autocomplete: "off" });
    inputs[parameter.name] = { input, place: parameter.in, isFlag };
    form.append(html("p", {}, html("label", {}, input, ` ${parameter.name} `), parameter.description ?? ""));
  }
  const bodies = operation.requestBody?.content ?? {};
  const example = bodies["application/json"]?.example;
  let body = null;
  if (example !== undefined) {
    body = html("textarea", { "aria-label": `Body of ${method} ${path}`, spellcheck: "false" });
    body.value = JSON.stringify(example, null, 1);
    form.append(body);
  }
  if (bodies["multipart/form-data"]) {
    form.append(html("p", { class: "hint" }, "The body can also be multipart/form-data, with the files `image` and `range` and text fields. With curl:"));
    const extra = path.includes("observations") ? " -F t_s=1" : "";
    form.append(html("pre", { tabindex: 0 }, `curl -F image=@panorama.jpg -F range=@range.png${extra} ${location.origin}${path}`));
  }
  const result = html("pre", { role: "status", tabindex: 0, "aria-label": `Answer of ${method} ${path}` });
  result.hidden = true;
  form.append(html("button", { type: "submit" }, "Run"));
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    if (inputs.session_id && inputs.session_id.input.value === "") inputs.session_id.input.value = lastSession;
    result.hidden = false;
    result.textContent = await answer(path, method, inputs, body?.value);
  });
  return html("section", { class: "card" }, ...parts, form, result);
}

async function answer(path, method, inputs, body) {
  const query = new URLSearchParams();
  let target = path;
  for (const [name, { input, place, isFlag }] of Object.entries(inputs)) {
    if (place === "path") target = target.replace(`{${name}}`, encodeURIComponent(input.value || "-"));
    else if (isFlag ? input.checked : input.value) query.set(name, isFlag ? "true" : input.value);
  }
  if (query.size) target += `?${query}`;
  const headers = body === undefined ? {} : { "Content-Type": "application/json" };
  try {
    const response = await request(target, { method, headers, body });
    const text = await response.text();
    if (path === "/sessions") lastSession = JSON.parse(text).id;
    return `${response.status}\n${shorten(response, text)}`;
  } catch (error) {
    return error.message;
  }
}

function shorten(response, text) {
  const isJson = (response.headers.get("Content-Type") ?? "").includes("json");
  const shown = isJson && text ? JSON.stringify(JSON.parse(text), null, 1) : text;
  return shown.length > MAX_SHOWN ? `${shown.slice(0, MAX_SHOWN)}\n… (${shown.length} characters)` : shown;
}
