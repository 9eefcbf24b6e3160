// Speaks with the service: every request, the token that it may ask for, and what went wrong as one sentence.

import { asSentence, show } from "./elements.js";

const TOKEN = "everplace-token";
const TRIES = 5; // while the service is busy
const PICTURES = 400; // kept, where they had to be fetched with the token

/** A request that failed; `message` is one sentence for the user. */
export class ServiceError extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

let asking = null;

/** Asks for the token once, however many requests wait for it. */
function tokenFromUser(refused) {
  asking ??= new Promise((resolve) => {
    const dialog = document.getElementById("token-dialog");
    const field = document.getElementById("token");
    show("token-problem", refused);
    field.value = "";
    dialog.addEventListener("cancel", (event) => event.preventDefault());
    document.getElementById("token-form").onsubmit = () => {
      sessionStorage.setItem(TOKEN, field.value.trim());
      asking = null;
      resolve();
    };
    dialog.showModal();
    field.focus();
  });
  return asking;
}

async function sentenceOf(response) {
  try {
    const { detail } = await response.json();
    if (typeof detail === "string" && detail) return asSentence(detail);
  } catch {
    // An answer that is not JSON comes from something in between, of which the status is all there is to say.
  }
  return `The service answered with ${response.status} ${response.statusText}.`;
}

const pause = (seconds) => new Promise((resolve) => setTimeout(resolve, 1000 * seconds));

/** Fetches, with the token, and again where the service is busy; throws `ServiceError`. */
export async function request(path, options = {}) {
  for (let attempt = 1; ; attempt += 1) {
    const token = sessionStorage.getItem(TOKEN);
    let response;
    try {
      response = await fetch(path, { ...options, headers: token ? { Authorization: `Bearer ${token}` } : {} });
    } catch {
      throw new ServiceError("The service does not answer; see whether everplace serve still runs.", 0);
    }
    if (response.ok) return response;
    if (response.status === 401) {
      // Another request may have been given a newer token meanwhile.
      if (sessionStorage.getItem(TOKEN) === token) await tokenFromUser(token !== null);
    } else if ([429, 503].includes(response.status) && attempt < TRIES) {
      await pause(Number(response.headers.get("Retry-After")) || attempt);
    } else {
      throw new ServiceError(await sentenceOf(response), response.status);
    }
  }
}

function form(fields) {
  const data = new FormData();
  for (const [name, value] of Object.entries(fields)) {
    if (value instanceof File) data.append(name, value, value.name);
    else if (value !== null) data.append(name, String(value));
  }
  return data;
}

/** What `GET /map` says. */
export const readMap = async () => (await request("/map")).json();

/** The answer to one frame, with `matches` places and with the numbers behind it; `session` null: the frame alone. */
export async function localize(file, frame, session, matches) {
  const body = form({ image: file, frame, session, matches, details: true });
  return (await request("/localize", { method: "POST", body })).json();
}

/** Forgets a drive. */
export const endSession = (session) => request(`/sessions/${session}`, { method: "DELETE" }).catch(() => {});

/** The frame in another condition, as the URL of a picture. */
export async function translated(file, condition) {
  const response = await request("/translate", { method: "POST", body: form({ image: file, condition }) });
  return URL.createObjectURL(await response.blob());
}

const pictures = new Map();

/** The URL of a picture of the map; one that needs the token is fetched first. */
export async function pictureOf(id, version) {
  const path = `/frames/${id}?version=${version}`;
  if (!sessionStorage.getItem(TOKEN)) return path;
  if (!pictures.has(path)) {
    pictures.set(path, request(path).then(async (response) => URL.createObjectURL(await response.blob())));
    pictures.get(path).catch(() => pictures.delete(path));
    if (pictures.size > PICTURES) {
      const [oldest, url] = pictures.entries().next().value;
      pictures.delete(oldest);
      url.then(URL.revokeObjectURL, () => {});
    }
  }
  return pictures.get(path);
}
