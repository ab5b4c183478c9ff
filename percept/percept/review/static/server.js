// What the page asks of the server that showed it.

async function ask(path, options = {}) {
  let answer;
  try {
    answer = await fetch(path, { credentials: "same-origin", cache: "no-store", ...options });
  } catch {
    return { lost: true };
  }
  if (answer.status === 403) {
    return { status: 403, error: "this page is of an earlier start; open the address that `percept map review` printed last" };
  }
  let content;
  try {
    content = await answer.json();
  } catch {
    content = { error: `the server answered ${answer.status}` };
  }
  return { status: answer.status, ...content };
}

export const newState = (since) => ask(`/state?since=${since}`);
export const historyOf = (id) => ask(`/history?id=${encodeURIComponent(id)}`);
export const mapLines = () => ask("/map.json");
export const evidenceOf = (id) => `/evidence?id=${encodeURIComponent(id)}`;

/** Resolves when the decision is on the disk, or was refused. */
export const decide = (id, status, comment, after) =>
  ask("/decide", {
    method: "POST",
    headers: { "Content-Type": "application/json" },
    body: JSON.stringify({ id, status, comment, after }),
  });
