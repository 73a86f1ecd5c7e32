// Requests to the service, with a token if the service requires one.

import { byId } from "./elements.js";

const KEY = "salframe-token";

export const token = () => sessionStorage.getItem(KEY);

// Send a request. Asks for the token if it is missing or wrong. Throws an Error with one sentence.
export async function request(path, options = {}) {
  for (;;) {
    const headers = { ...options.headers };
    if (token() !== null) headers.Authorization = `Bearer ${token()}`;
    let response;
    try {
      response = await fetch(path, { ...options, headers });
    } catch {
      throw new Error("The server does not answer. Check that it is running, and try again.");
    }
    if (response.status === 401) {
      await askForToken();
      continue;
    }
    if (!response.ok) throw new Error(await describe(response));
    return response;
  }
}

export async function requestJson(path, body) {
  const options = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  return (await request(path, body === undefined ? { method: "POST" } : options)).json();
}

// Open the stream of a session. The token is the first message, because a URL may be logged.
export function openStream(id, receive, closed) {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  const socket = new WebSocket(`${scheme}//${location.host}/sessions/${encodeURIComponent(id)}/stream`);
  socket.addEventListener("open", () => {
    if (token() !== null) socket.send(JSON.stringify({ token: token() }));
  });
  socket.addEventListener("message", (event) => receive(JSON.parse(event.data)));
  socket.addEventListener("close", closed);
  return socket;
}

async function describe(response) {
  try {
    const problem = await response.json();
    const wait = response.headers.get("Retry-After");
    return wait === null ? problem.detail : `${problem.detail} (after ${wait} s)`;
  } catch {
    return `The server answered ${response.status}.`;
  }
}

let asking = null;

function askForToken() {
  asking ??= new Promise((resolve) => {
    const dialog = byId("token-dialog");
    byId("token").value = "";
    dialog.addEventListener("cancel", (event) => event.preventDefault());
    dialog.addEventListener("close", () => {
      sessionStorage.setItem(KEY, byId("token").value.trim());
      asking = null;
      resolve();
    }, { once: true });
    dialog.showModal();
  });
  return asking;
}
