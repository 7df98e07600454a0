// Requests to the server; its refusals become errors with one line for each fault.

export class Refused extends Error {
  /** `faults` are lines for the reader; `status` is that of the answer, 0 without one. */
  constructor(faults, status) {
    super(faults.join("\n"));
    this.faults = faults;
    this.status = status;
  }
}

/** The JSON that the server answers. */
export async function ask(path, method = "GET", body = undefined) {
  let answer;
  try {
    answer = await fetch(path, { method, body, headers: typeof body === "string" ? { "Content-Type": "application/json" } : {} });
  } catch {
    throw new Refused(["The server does not answer. Is renew serve still running?"], 0);
  }
  const content = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Refused(content.faults || [`The server answered ${answer.status}.`], answer.status);
  return content;
}

/** Send a file; its id names it in a plan. */
export function send(file) {
  const name = file.name.replace(/[^A-Za-z0-9_()+,=@. -]/g, "_").replace(/^\.+/, "").slice(-100) || "file";
  return ask(`/api/files?name=${encodeURIComponent(name)}`, "POST", file);
}

export const pause = (ms) => new Promise((done) => { setTimeout(done, ms); });
