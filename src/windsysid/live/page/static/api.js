// Requests to the service, and its events.

const PATIENCE = 30000; // ms, then an error instead of a page that waits

export class Refused extends Error {
  constructor(status, text) {
    super(text);
    this.status = status;
  }
}

export async function ask(path, body) {
  const options = body === undefined ? {} : {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
  };
  const answer = await fetch(path, { cache: "no-store", signal: AbortSignal.timeout(PATIENCE), ...options });
  const said = await answer.json().catch(() => ({}));
  if (!answer.ok) {
    const text = Array.isArray(said.detail) ? said.detail.map((one) => one.msg).join("; ") : said.detail;
    throw new Refused(answer.status, text || `the service answered ${answer.status}`);
  }
  return said;
}

export const turbinePath = (name, rest = "") => `/api/turbines/${encodeURIComponent(name)}${rest}`;

export const acknowledge = (key, by, remark) =>
  ask(`/api/alarms/${encodeURIComponent(key)}/acknowledge`, { by, remark });

// One event stream for each page; it reconnects and resumes after the last event.
export function listen(after, onChanges, onState) {
  let last = after;
  let source;
  const open = () => {
    source = new EventSource(`/api/events?after=${last}`);
    source.addEventListener("open", () => onState(true));
    source.addEventListener("changes", (event) => {
      last = Number(event.lastEventId);
      onChanges(JSON.parse(event.data));
    });
    source.addEventListener("error", () => {
      onState(false);
      if (source.readyState === EventSource.CLOSED) setTimeout(open, 5000);
    });
  };
  open();
  window.addEventListener("pagehide", () => source.close());
}
